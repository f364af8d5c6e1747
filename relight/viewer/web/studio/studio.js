// The viewer with photos of the user's own: opened, masked and inferred in the browser.

import { ready } from "../page/main.js";
import { openLight, putFigure } from "../page/loading.js";
import { notify, onFile } from "../page/panel.js";
import { isPicture, readPhoto } from "../page/photo.js";
import { bilinear, resample } from "../page/resample.js";
import { openingTurn } from "../page/turning.js";
import { app, element, page } from "../page/state.js";
import { paintMask, startBrush } from "./brush.js";
import { startEngine } from "./engine.js";

const LONGEST = 1024; // pixels of the photo's longer side, as `relight view` has it
const LARGEST = 3072; // pixels of the longer side of a picture that is saved
// Of figures that were inferred here: photo, coverage, title, file, isExact, and coverageOf, a function of what `prepare`
// answers at another size.
const own = new Map();
let engine = null; // a promise of the engine

function tell(text, share = null) {
  const status = element("photo-status");
  element("photo-step").textContent = text;
  status.hidden = !text;
  status.querySelector("progress").hidden = share === null;
  if (share !== null) status.querySelector("progress").value = share;
}

function startOnce() {
  engine ??= startEngine((share, total) => {
    tell(`Loading what infers, once: ${Math.round((share * total) / 1e6)} of ${Math.round(total / 1e6)} MB`, share);
  }).then((ask) => {
    tell("");
    element("photo-ready").hidden = false;
    return ask;
  });
  engine.catch((error) => {
    tell("");
    notify(error.message);
    engine = null;
  });
  return engine;
}

// Infers the figure and shows it, in the place of figure `index` if that is given. Returns the milliseconds that it took.
async function develop(photo, coverage, source, index) {
  const ask = await startOnce(), began = performance.now();
  tell("Inferring albedo, light and transport …");
  const figure = await ask("infer", { photo, coverage, isExact: source.isExact, size: page.web.size });
  tell("");
  if (!figure) throw new Error("The mask holds nobody: paint the person, at least 8 pixels tall.");
  figure.title = source.title;
  own.set(figure, { ...source, photo, coverage });
  await putFigure(source.title, figure, index);
  openingTurn();
  return performance.now() - began;
}

async function paintAndDevelop(photo, coverage, source, { index, why } = {}) {
  const painted = await paintMask(photo, coverage, source.title, why);
  if (!painted) return;
  const coverageOf = (large) => resample(painted, photo.width, [large.photo.width, large.photo.height], bilinear);
  await develop(photo, painted, { ...source, isExact: false, coverageOf }, index);
}

// The shown figure at the photo's own size, or null where that is no larger, or is not known.
async function atOwnSize() {
  const { file, isExact, coverageOf } = own.get(app.figure) ?? {};
  const read = file && (await readPhoto(file, LARGEST));
  if (!read || Math.max(read.width, read.height) <= LONGEST) return null;
  const ask = await startOnce();
  tell("Inferring at the photo's own size …");
  const large = await ask("prepare", { photo: read, longest: LARGEST }, [read.pixels.buffer]);
  const coverage = await coverageOf(large);
  const figure = await ask("infer", { photo: large.photo, coverage, isExact, size: page.web.size });
  tell("");
  return figure;
}

async function openPhoto(file) {
  const source = { title: file.name.replace(/\.[^.]+$/, ""), file }, ask = await startOnce();
  tell("Reading the photo …");
  const read = await readPhoto(file);
  const { photo, alpha } = await ask("prepare", { photo: read, longest: LONGEST }, [read.pixels.buffer]);
  tell("Looking for the person …");
  const coverage = alpha ?? (await ask("mask", { photo }));
  tell("");
  const coverageOf = alpha ? (large) => large.alpha : (large) => ask("mask", { photo: large.photo });
  if (coverage?.some((v) => v >= 128)) return develop(photo, coverage, { ...source, isExact: Boolean(alpha), coverageOf });
  const why = coverage ? "Nobody was found in this photo." : "";
  return paintAndDevelop(photo, new Uint8Array(photo.width * photo.height), source, { why });
}

const guarded = (act) => (...values) => act(...values).catch((error) => {
  tell("");
  notify(error.message);
});
const open = guarded(openPhoto);

function openFile(file) {
  return isPicture(file) ? open(file) : openLight(file);
}

async function start() {
  startBrush();
  Object.assign(app, { openFile, beforeReading: startOnce, atOwnSize: guarded(atOwnSize) });
  element("drop").textContent = "Drop a photo, or an .hdr panorama to light with";
  onFile(element("photo-file"), open);
  const edit = element("edit-mask");
  edit.addEventListener("click", guarded(() => {
    const { photo, coverage, ...source } = own.get(app.figure);
    return paintAndDevelop(photo, coverage, source, { index: app.index });
  }));
  await ready;
  app.onFigure = () => (edit.hidden = !own.has(app.figure));
  if (!navigator.connection?.saveData) startOnce();
}

start();

// For tests.
Object.assign(window.relight, { openPhoto, paintAndDevelop, engine: startOnce });
