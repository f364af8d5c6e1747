// The page's start; keys, buttons, sliders and pointers.

import { decodePlanes, inflate } from "./codec.js";
import { project, readHDR } from "./hdr.js";
import { lampLight } from "./lamps.js";
import { fromAddress, toParameters, writeAddress } from "./link.js";
import { addLight, choose, openLight, openPanorama, openPlace, sourcesOf } from "./loading.js";
import { MODES, addLamp, listChoices, notify, onFile, refresh } from "./panel.js";
import { canvas, fit, pixels, placement, redraw, stage } from "./picture.js";
import { listen } from "./placement.js";
import { Renderer } from "./render.js";
import { record, saveMovie, savePicture } from "./saving.js";
import { deringed, rotate, turn } from "./sh.js";
import { app, element, embedded, set, state, subscribe } from "./state.js";
import { autoRotate, openingTurn, stopOpening } from "./turning.js";

function drag(from, to) {
  app.isDragged = true;
  turnBy((to.x - from.x) / 2, (from.y - to.y) / 2);
}

function turnBy(yaw, tilt) {
  element("hint").classList.add("gone");
  set({ yaw: state.yaw + yaw, tilt: state.tilt + tilt });
}

function next(list, current, by = 1) {
  return list[(list.indexOf(current) + by + list.length) % list.length];
}

// Opens files one after the other: a photo may first need its mask.
async function openFiles(files) {
  if (!app.figure) return;
  for (const file of [...files]) await (app.openFile ?? openLight)(file);
}

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else if (stage.requestFullscreen) stage.requestFullscreen();
  else document.body.classList.toggle("plain"); // iPhone: no full screen for a page, so the controls go
}

async function movie() {
  const button = element("movie");
  button.disabled = true;
  const isSaved = await saveMovie((share) => (button.textContent = `${Math.round(100 * share)} %`)).catch(() => false);
  button.disabled = false;
  button.textContent = "Movie";
  if (!isSaved) notify("This browser cannot record a movie.");
}

const values = (name) => [...document.querySelectorAll(`input[name=${name}]`)].map((input) => input.value);
const KEYS = {
  ArrowLeft: () => turnBy(-5, 0), ArrowRight: () => turnBy(5, 0),
  ArrowUp: () => turnBy(0, 5), ArrowDown: () => turnBy(0, -5),
  " ": () => autoRotate(!state.auto),
  "[": () => set({ light: (state.light + app.shown.length - 1) % app.shown.length }),
  "]": () => set({ light: (state.light + 1) % app.shown.length }),
  "+": () => set({ stops: state.stops + 0.25 }), "=": () => KEYS["+"](), "-": () => set({ stops: state.stops - 0.25 }),
  c: () => set({ before: state.before === "none" ? [...element("before").options].find(({ value }) => value !== "none" && value !== state.view).value : "none" }),
  b: () => set({ background: next(values("background"), state.background) }),
  l: addLamp,
  r: () => set({ yaw: 0, tilt: 0, stops: 0, room: 1, lamps: [] }),
  0: fit,
  s: () => savePicture("png"), j: () => savePicture("jpeg"), m: movie, f: fullScreen, "?": () => element("keys").showModal(),
};

document.addEventListener("keydown", (event) => {
  if (!app.figure || app.isPainting || event.ctrlKey || event.metaKey || event.altKey || element("keys").open) return;
  if (event.target.matches("select")) return;
  if (event.target.matches("input, [role=slider]") && /^Arrow|^ $/.test(event.key)) return;
  if (event.target.matches("button") && event.key === " ") return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const view = values("view")[Number(key) - 1];
  if (view) set({ view });
  else if (KEYS[key]) KEYS[key]();
  else return;
  event.preventDefault();
});
for (const name of ["pointerdown", "keydown", "wheel"]) {
  document.addEventListener(name, stopOpening, { capture: true, passive: true });
}

element("yaw").addEventListener("input", (event) => {
  set({ yaw: Math.min(Number(event.target.value), 179.999), auto: false }); // 180 would jump to -180 under the thumb
});
element("taken").addEventListener("change", (event) => set({ taken: event.target.value }));
element("takenYaw").addEventListener("input", (event) => set({ takenYaw: Math.min(Number(event.target.value), 179.999) }));
element("tilt").addEventListener("input", (event) => set({ tilt: Number(event.target.value) }));
element("exposure").addEventListener("input", (event) => set({ stops: Number(event.target.value) }));
element("room").addEventListener("input", (event) => set({ room: Number(event.target.value) }));
element("color").addEventListener("input", (event) => set({ color: event.target.value }));
element("before").addEventListener("change", (event) => set({ before: event.target.value }));
element("figure").addEventListener("change", (event) => {
  const { source } = embedded[app.index]?.dataset ?? {}, found = sourcesOf(Number(event.target.value));
  choose(found.find((i) => source && embedded[i]?.dataset.source === source) ?? found[0]);
});
element("source").addEventListener("change", (event) => choose(Number(event.target.value)));
onFile(element("place-file"), (file) => openPlace(file, true));
element("auto").addEventListener("click", () => autoRotate(!state.auto));
element("add-lamp").addEventListener("click", addLamp);
element("reset").addEventListener("click", KEYS.r);
element("save").addEventListener("click", KEYS.s);
element("jpeg").addEventListener("click", KEYS.j);
element("movie").addEventListener("click", movie);
element("full").addEventListener("click", fullScreen);
element("help").addEventListener("click", KEYS["?"]);

const split = element("split");
split.addEventListener("pointerdown", (event) => split.setPointerCapture(event.pointerId));
split.addEventListener("pointermove", (event) => {
  if (!split.hasPointerCapture(event.pointerId)) return;
  set({ split: (event.clientX - stage.getBoundingClientRect().left) / stage.clientWidth });
});
split.addEventListener("keydown", (event) => {
  const by = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.key];
  if (!by) return;
  set({ split: state.split + by });
  event.preventDefault();
});

for (const name of ["dragenter", "dragover"]) {
  document.addEventListener(name, (event) => {
    event.preventDefault();
    element("drop").hidden = !app.figure;
  });
}
document.addEventListener("dragleave", (event) => (element("drop").hidden = event.relatedTarget === null));
document.addEventListener("drop", (event) => {
  event.preventDefault();
  element("drop").hidden = true;
  openFiles(event.dataTransfer.files);
});
document.addEventListener("paste", (event) => openFiles(event.clipboardData.files));

async function start() {
  if (!window.DecompressionStream) {
    throw new Error("This browser is too old to unpack the page: Chrome 108, Safari 16.4 or Firefox 121 would do.");
  }
  app.renderer = new Renderer(canvas, element("fragment").textContent.trim());
  canvas.addEventListener("redraw", redraw);
  listen(canvas, placement, { onDrag: drag, onChange: redraw, onFit: fit });
  embedded.forEach((script, i) => {
    if (sourcesOf(i)[0] === i) element("figure").append(new Option(script.dataset.title, i));
  });
  element("figures").hidden = embedded.length < 2;
  listChoices(element("mode-list"), "mode", ["ratio", "full"], MODES);
  const asked = fromAddress(location.hash);
  await choose(embedded[asked.figure] ? asked.figure : 0);
  const first = state.background;
  if (asked.own) addLight(asked.light ?? "Own", asked.own);
  const light = app.shown.findIndex(({ name }) => name === asked.light);
  const known = { view: values("view"), before: [...element("before").options].map(({ value }) => value) };
  Object.assign(known, { background: values("background"), mode: values("mode"), taken: app.shown.map(({ name }) => name) });
  for (const [name, all] of Object.entries(known)) if (!all.includes(asked.changes[name])) delete asked.changes[name];
  set({ ...asked.changes, ...(light > 0 && { light }) });
  subscribe(() => writeAddress(first));
  let isFitted = true;
  new ResizeObserver(() => {
    isFitted = placement.scale === placement.fitted;
    if (isFitted) placement.fit(app.figure);
    refresh();
  }).observe(stage);
  if (!location.hash) openingTurn();
}

const ready = start().catch((error) => {
  element("loading").textContent = error.message; // for good: nothing of the page works
  element("loading").setAttribute("role", "alert");
  element("hint").hidden = element("panel").inert = true;
  throw error;
});

// For tests, and for a page that embeds this one.
window.relight = {
  state, choose, placement, readHDR, project, rotate, turn, deringed, inflate, decodePlanes, openPanorama, openPlace, redraw, refit: fit,
  lampLight, record, ready,
  set: (changes) => {
    stopOpening();
    set(changes);
  },
  pixels: () => pixels(state.split * app.figure.width),
  lights: () => app.shown,
  figure: () => app.figure,
  frames: () => app.frames,
  address: () => toParameters(null).toString(),
};

export { ready };
