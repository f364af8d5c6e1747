// The controls beside the stage: they follow the state, whoever changed it.

import { drawBall } from "./ball.js";
import { NEW_LAMP, fromMap, onMap } from "./lamps.js";
import { canvas, redraw, stage } from "./picture.js";
import { app, element, set, state, subscribe } from "./state.js";

const LABELS = {
  relit: "Relit", photo: "Photo", picture: "Picture", albedo: "Albedo", shading: "Shading", ao: "Occlusion", normal: "Normals",
  open: "No occlusion", studio: "Studio", color: "Color", clear: "Clear", light: "Light",
};
const MODES = { ratio: "Keep the photo", full: "From the maps" };
const NOTES = {
  ratio: "The photo times new shading over old: every detail stays.",
  full: "Albedo times shading: what the network understood.",
};

// Radio buttons for `values` of the state's `name`.
function listChoices(list, name, values, labels = LABELS) {
  list.replaceChildren(...values.map((value) => {
    const label = document.createElement("label"), input = document.createElement("input");
    Object.assign(input, { type: "radio", name, value });
    input.addEventListener("change", () => set({ [name]: value }));
    label.append(input, labels[value]);
    return label;
  }));
}

// Calls `open` with each file that is given to an input.
function onFile(input, open) {
  input.addEventListener("change", () => {
    const [file] = input.files;
    input.value = ""; // so that the same file can be opened again
    if (file) open(file);
  });
}

// A ball under each light; openers: what is done with the files of the last tiles, by their selectors.
function listLights(openers) {
  element("light-list").replaceChildren(...app.shown.map(({ name, values }, i) => {
    const label = document.createElement("label"), input = document.createElement("input");
    const ball = document.createElement("canvas"), text = document.createElement("span");
    Object.assign(input, { type: "radio", name: "light", value: i });
    Object.assign(ball, { width: 96, height: 96 });
    label.title = name;
    text.textContent = name.replace(/([:@,/])(?=\S)/g, "$1\u200b"); // may break after these
    input.addEventListener("change", () => set({ light: i }));
    drawBall(ball, values);
    label.append(input, ball, text);
    return label;
  }));
  const tile = element("open-tile").content.cloneNode(true);
  for (const [tileOf, open] of Object.entries(openers)) onFile(tile.querySelector(`${tileOf} input`), open);
  element("light-list").append(tile);
}

function changeLamp(index, changes) {
  set({ lamps: state.lamps.map((lamp, i) => (i === index ? { ...lamp, ...changes } : lamp)) });
}

function addLamp() {
  const n = state.lamps.length;
  set({ lamps: [...state.lamps, { ...NEW_LAMP, azimuth: n % 2 ? 60 + 15 * n : NEW_LAMP.azimuth - 15 * n }] });
}

function lampControls(index) {
  const row = element("lamp-row").content.cloneNode(true).firstElementChild, of = (name) => row.querySelector(name);
  of("legend").textContent = `Lamp ${index + 1}`;
  of(".color").addEventListener("input", (event) => changeLamp(index, { color: event.target.value }));
  of(".strength").addEventListener("input", (event) => changeLamp(index, { strength: Number(event.target.value) }));
  of(".softness").addEventListener("input", (event) => changeLamp(index, { softness: Number(event.target.value) }));
  of(".remove").addEventListener("click", () => set({ lamps: state.lamps.filter((_, i) => i !== index) }));
  return row;
}

// A handle on the stage that is dragged over the map of all directions (lamps.js), or moved by the arrow keys.
function lampHandle(index) {
  const handle = document.createElement("button");
  handle.className = "lamp";
  handle.setAttribute("aria-label", `Direction of lamp ${index + 1}; arrow keys move it`);
  const map = () => {
    const { left, top, width, height } = stage.getBoundingClientRect(), radius = 0.46 * Math.min(width, height);
    return { x: left + width / 2, y: top + height / 2, radius };
  };
  handle.addEventListener("pointerdown", (event) => handle.setPointerCapture(event.pointerId));
  handle.addEventListener("pointermove", (event) => {
    if (!handle.hasPointerCapture(event.pointerId)) return;
    const { x, y, radius } = map();
    changeLamp(index, fromMap((event.clientX - x) / radius, (event.clientY - y) / radius));
  });
  handle.addEventListener("keydown", (event) => {
    const [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] ?? [];
    if (dx === undefined) return;
    const [x, y] = onMap(state.lamps[index]);
    changeLamp(index, fromMap(x + dx / 36, y + dy / 36));
    event.preventDefault();
    event.stopPropagation();
  });
  return handle;
}

function refreshLamps() {
  const rows = element("lamp-list"), handles = element("lamp-handles");
  if (rows.children.length !== state.lamps.length) {
    rows.replaceChildren(...state.lamps.map((_, i) => lampControls(i)));
    handles.replaceChildren(...state.lamps.map((_, i) => lampHandle(i)));
  }
  if (!state.lamps.length) return;
  const radius = 0.46 * Math.min(stage.clientWidth, stage.clientHeight);
  state.lamps.forEach((lamp, i) => {
    const row = rows.children[i], [x, y] = onMap(lamp);
    for (const name of ["color", "strength", "softness"]) row.querySelector(`.${name}`).value = lamp[name];
    row.querySelector(".strength").nextElementSibling.textContent = `×${Math.round(lamp.strength * 10) / 10}`;
    row.querySelector(".softness").nextElementSibling.textContent = `${Math.round(lamp.softness)}°`;
    handles.children[i].style.cssText =
      `left: ${stage.clientWidth / 2 + radius * x}px; top: ${stage.clientHeight / 2 + radius * y}px; --lamp: ${lamp.color}`;
  });
}

// Sets the text of an element. Texts that stay are left alone: a new one costs a frame milliseconds.
function write(id, text) {
  if (element(id).textContent !== text) element(id).textContent = text;
}

function refresh() {
  if (!app.figure) return;
  const name = app.shown[state.light].name, pad = (v) => `${v > 0 ? "+" : v < 0 ? "−" : ""}${Math.abs(v)}`;
  element("taken").value = state.taken;
  element("taken-row").hidden = state.mode !== "ratio";
  element("taken-turn").hidden = state.mode !== "ratio" || !state.taken;
  for (const id of ["yaw", "tilt", "takenYaw"]) {
    element(id).value = state[id];
    element(id).nextElementSibling.textContent = `${pad(Math.round(state[id]))}°`;
  }
  element("exposure").value = state.stops;
  element("exposure").nextElementSibling.textContent = pad(Math.round(state.stops * 100) / 100);
  element("room").value = state.room;
  element("room").nextElementSibling.textContent = `${Math.round(100 * state.room)} %`;
  for (const key of ["light", "view", "mode", "background"]) {
    const input = document.querySelector(`input[name=${key}][value="${state[key]}"]`);
    if (input) input.checked = true;
  }
  refreshLamps();
  element("auto").setAttribute("aria-pressed", state.auto);
  element("before").value = state.before;
  for (const option of element("before").options) option.disabled = option.value === state.view;
  element("color-row").hidden = state.background !== "color";
  element("color").value = state.color;
  write("mode-note", NOTES[state.mode]);
  canvas.classList.toggle("clear", state.background === "clear");
  const split = element("split"), percent = Math.round(state.split * 100);
  split.hidden = state.before === "none";
  split.style.left = `${state.split * 100}%`;
  split.setAttribute("aria-valuenow", percent);
  write("split-left", LABELS[state.before] ?? "");
  write("split-right", LABELS[state.view]);
  write("status", `${LABELS[state.view]} · ${name}`);
  canvas.setAttribute("aria-label", `${app.figure.title}, ${LABELS[state.view].toLowerCase()}, light ${name}`);
  redraw();
}

// Shows a message for some seconds.
function notify(message, isError = true) {
  const toast = element("toast");
  toast.textContent = message;
  toast.classList.toggle("error", isError);
  toast.hidden = false;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => (toast.hidden = true), 7000);
}

subscribe(refresh);

export { LABELS, MODES, addLamp, listChoices, listLights, notify, onFile, refresh };
