// The page's state, and what of it is shown.

const element = (id) => document.getElementById(id);
const page = JSON.parse(element("page").textContent);
const figures = [...document.querySelectorAll("script.figure")];
const LABELS = {
  relit: "Relit", photo: "Photo", albedo: "Albedo", shading: "Shading", ao: "Occlusion", normal: "Normals",
  open: "No occlusion", studio: "Studio", color: "Colour", clear: "Clear", light: "Light",
};
const MODES = { ratio: "Keep the photo", full: "From the maps" };
const NOTES = {
  ratio: "The photo times new shading over old: every detail stays.",
  full: "Albedo times shading: what the network understood.",
};

const state = {
  light: 0, yaw: 0, tilt: 0, stops: 0, view: "relit", before: "none", split: 0.5, background: page.background,
  color: "#e8e4dc", mode: "ratio", auto: false,
};
const lights = page.lights.map(({ name, values }) => ({ name, values: Float64Array.from(values.flat()) }));
const canvas = element("view"), stage = element("stage"), placement = new Placement(stage);
let renderer, figure, shownLights = [], frames = 0;

function turnedLight() {
  return rotate(shownLights[state.light].values, turn((state.yaw * Math.PI) / 180, (state.tilt * Math.PI) / 180));
}

function backdrop() {
  return [1, 3, 5].map((i) => parseInt(state.color.slice(i, i + 2), 16) / 255);
}

function scene(split) {
  return {
    light: turnedLight(), view: state.view, background: state.background, backdrop: backdrop(),
    exposure: 2 ** state.stops, ratio: state.mode === "ratio",
    ...(state.before === "none" ? {} : { before: state.before, split }),
  };
}

let isWaiting = false;
function redraw() {
  if (isWaiting || !figure) return;
  isWaiting = true;
  requestAnimationFrame(() => {
    isWaiting = false;
    draw();
  });
}

function draw() {
  const ratio = Math.min(window.devicePixelRatio || 1, 2.5);
  const [width, height] = [stage.clientWidth, stage.clientHeight].map((side) => Math.max(Math.round(side * ratio), 1));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  renderer.draw(scene(state.split * width), placement.corner(ratio), width, height);
  drawBall(element("ball"), turnedLight(), 2 ** state.stops);
  frames++;
}

// Controls follow the state, whoever changed it.
function refresh() {
  const name = shownLights[state.light].name, pad = (v) => `${v > 0 ? "+" : v < 0 ? "−" : ""}${Math.abs(v)}`;
  for (const id of ["yaw", "tilt"]) {
    element(id).value = state[id];
    element(id).nextElementSibling.value = `${pad(Math.round(state[id]))}°`;
  }
  element("exposure").value = state.stops;
  element("exposure").nextElementSibling.value = pad(Math.round(state.stops * 100) / 100);
  for (const key of ["light", "view", "mode", "background"]) {
    const input = document.querySelector(`input[name=${key}][value="${state[key]}"]`);
    if (input) input.checked = true;
  }
  element("auto").setAttribute("aria-pressed", state.auto);
  element("before").value = state.before;
  element("color-row").hidden = state.background !== "color";
  element("color").value = state.color;
  element("mode-note").textContent = NOTES[state.mode];
  canvas.classList.toggle("clear", state.background === "clear");
  const split = element("split"), percent = Math.round(state.split * 100);
  split.hidden = state.before === "none";
  split.style.left = `${state.split * 100}%`;
  split.setAttribute("aria-valuenow", percent);
  element("split-left").textContent = LABELS[state.before] ?? "";
  element("split-right").textContent = LABELS[state.view];
  const status = `${LABELS[state.view]} · ${name}`;
  if (element("status").textContent !== status) element("status").textContent = status;
  canvas.setAttribute("aria-label", `${figure.title}, ${LABELS[state.view].toLowerCase()}, light ${name}`);
  redraw();
}

function set(changes) {
  Object.assign(state, changes);
  state.yaw = ((((state.yaw + 180) % 360) + 360) % 360) - 180;
  state.tilt = Math.min(Math.max(state.tilt, -90), 90);
  state.stops = Math.min(Math.max(state.stops, -3), 3);
  state.split = Math.min(Math.max(state.split, 0), 1);
  refresh();
}

function turnBy(yaw, tilt) {
  element("hint").classList.add("gone");
  set({ yaw: state.yaw + yaw, tilt: state.tilt + tilt });
}
