// Figures and lights: those embedded in the page, and the user's own.

import { loadFigure } from "./figure.js";
import { project, readHDR } from "./hdr.js";
import { LABELS, listChoices, listLights, notify, refresh } from "./panel.js";
import { isPicture, onWhite, readPhoto } from "./photo.js";
import { placement } from "./picture.js";
import { placeLight, whiteOf } from "./place.js";
import { deringed, rotate, turn } from "./sh.js";
import { app, element, embedded, page, set, state } from "./state.js";

const LONGEST = 2048; // pixels of a place's picture: what every texture can hold

// The factor for a light that gives the figure the brightness it has under `reference`: the mean luminance of its
// shading at the turn about the vertical where it is largest, or .6 of the largest channel of a light of a deep color
// (relight.photos.shading.exposure_factor).
function matched(reference, light) {
  const brightest = (values) => {
    const luminances = Array.from({ length: 72 }, (_, step) => {
      const turned = rotate(values, turn((2 * Math.PI * step) / 72, 0));
      const luminance = (k) => 0.2126 * turned[3 * k] + 0.7152 * turned[3 * k + 1] + 0.0722 * turned[3 * k + 2];
      return app.figure.mean.reduce((sum, value, k) => sum + value * luminance(k), 0);
    });
    const color = Array.from(values.slice(0, 3), (value) => Math.max(value, 0));
    const level = 0.2126 * color[0] + 0.7152 * color[1] + 0.0722 * color[2];
    return Math.max(...luminances) * Math.max(1, (0.6 * Math.max(...color)) / Math.max(level, 1e-9));
  };
  const had = brightest(reference), has = brightest(light);
  return had > 1e-6 && has > 1e-6 ? had / has : 1;
}

function scaled(light, gain) {
  const panorama = light.panorama && { ...light.panorama, gain: light.panorama.gain * gain };
  return { ...light, values: light.values.map((value) => value * gain), ...(panorama && { panorama }) };
}

// The lights as this figure is shown under them: those of a photo are matched to the light that it was taken in.
function collectLights() {
  app.shown = app.lights;
  if (app.figure.light) {
    const own = Float64Array.from(app.figure.light.flat());
    app.shown = app.lights.map((light) => scaled(light, matched(own, light.values)));
    app.shown.unshift({ name: "As taken", values: own });
  }
  const known = app.shown.slice(1).map(({ name }) => new Option(name));
  element("taken").replaceChildren(new Option("the inferred light", ""), ...known);
  listLights({ ".panorama": openPanorama, ".place": openPlace });
}

// Adds a light of the user's own and shows it, at the brightness of the first one.
function addLight(name, values, panorama = null) {
  const light = { name, values, isOwn: true, ...(panorama && { panorama: { ...panorama, gain: 1 } }) };
  app.lights.push(scaled(light, matched(app.lights[0].values, values)));
  collectLights();
  set({ light: app.shown.length - 1 });
  element("light-list").children[state.light].scrollIntoView({ block: "nearest" });
}

const nameOf = (file) => file.name.replace(/\.[^.]+$/, "");

// What is dropped on the page, a panorama or a picture of a place, lights the figure.
function openLight(file) {
  return isPicture(file) ? openPlace(file, true) : openPanorama(file);
}

// A function of a file of the user's own that is called once such files may be read; what it throws is told.
const reading = (act) => async (file, ...values) => {
  try {
    await app.beforeReading?.();
    await act(file, ...values);
  } catch (error) {
    notify(error.message);
  }
};

const openPanorama = reading(async (file) => {
  const panorama = readHDR(await file.arrayBuffer()), light = deringed(project(panorama));
  if (!light.some((v) => v)) throw new Error("The panorama is black.");
  addLight(nameOf(file), light, panorama);
  set({ yaw: 0, tilt: 0 });
  if (panorama.note) notify(panorama.note);
});

// A picture of a place: its light, and it can be shown behind the figure.
const openPlace = reading(async (file, isBehind = false) => {
  const read = await readPhoto(file, LONGEST), picture = { ...read, pixels: onWhite(read.pixels) };
  app.picture = { ...picture, white: whiteOf(picture) };
  addLight(nameOf(file), deringed(placeLight(picture, page.place)));
  listBackgrounds();
  set({ yaw: 0, tilt: 0, ...(isBehind && { background: "picture" }) });
});

const figures = embedded.map((script) => async () => loadFigure(JSON.parse(script.textContent)));

// Adds a figure to those that the page offers, or puts it in the place of figure `index`, and shows it.
function putFigure(title, figure, index = figures.length) {
  if (index === figures.length) element("figure").append(new Option(title, index));
  element("figures").hidden = false;
  figures[index] = async () => figure;
  return choose(index);
}

// The indices of the figures that show the same as figure `index`: its maps from each of their sources.
function sourcesOf(index) {
  const { title, source } = embedded[index]?.dataset ?? {};
  const isSame = ({ dataset }) => dataset.title === title && dataset.source;
  return source ? [...embedded.keys()].filter((i) => isSame(embedded[i])) : [index];
}

function listBackgrounds() {
  const ifAny = [...(app.figure.photo ? ["photo"] : []), ...(app.picture ? ["picture"] : [])];
  listChoices(element("background-list"), "background", [...ifAny, "studio", "light", "color", "clear"]);
}

async function choose(index) {
  element("loading").hidden = false;
  await new Promise(requestAnimationFrame);
  const chosen = await figures[index]();
  const isFirst = !app.figure, shift = isFirst ? 0 : Boolean(chosen.light) - Boolean(app.figure.light); // by "As taken"
  Object.assign(app, { figure: chosen, index });
  app.renderer.show(chosen);
  const ifPhoto = chosen.photo ? ["photo"] : [], ifNormals = chosen.hasNormals ? ["normal"] : [];
  const views = ["relit", ...ifPhoto, "albedo", "shading", "ao", ...ifNormals];
  const sides = ["none", ...ifPhoto, ...(chosen.hasNormals ? ["open"] : []), "albedo", "shading"];
  listChoices(element("view-list"), "view", views);
  listBackgrounds();
  element("before").replaceChildren(...sides.map((side) => new Option(LABELS[side] ?? "nothing", side)));
  element("modes").hidden = !chosen.light;
  collectLights();
  if (isFirst) set({ background: state.background ?? (chosen.photo ? "photo" : "studio") });
  if (!views.includes(state.view)) set({ view: "relit" });
  if (!sides.includes(state.before)) set({ before: "none" });
  if (!chosen.photo && state.background === "photo") set({ background: "studio" });
  set({ light: Math.max(state.light + shift, 0) });
  placement.fit(chosen);
  const sources = sourcesOf(index);
  element("figure").value = sources[0];
  element("source").replaceChildren(...sources.map((i) => new Option(embedded[i]?.dataset.source, i)));
  element("source").value = index;
  element("sources").hidden = sources.length < 2;
  element("loading").hidden = true;
  app.onFigure?.();
  refresh();
}

export { addLight, choose, openLight, openPanorama, openPlace, putFigure, sourcesOf };
