// What the page holds: what it was built with, what the user chose, and what was loaded.

const element = (id) => document.getElementById(id);
const page = JSON.parse(element("page").textContent);
const embedded = [...document.querySelectorAll("script.figure")];
const DEFAULTS = Object.freeze({
  light: 0, room: 1, lamps: [], yaw: 0, tilt: 0, stops: 0, view: "relit", before: "none", split: 0.5, mode: "ratio",
  background: page.background, color: "#e8e4dc", auto: false,
  taken: "", takenYaw: 0, // the light that the photo was taken in, by its name: "" is the inferred one
});
const state = { ...DEFAULTS };
const app = {
  renderer: null,
  figure: null,
  index: 0, // of the figure
  lights: page.lights.map(({ name, values }) => ({ name, values: Float64Array.from(values.flat()) })), // as embedded
  shown: [], // the same, matched to the figure's photo
  picture: null, // of a place, to be shown behind: { pixels, width, height, white }
  frames: 0, // drawn so far
  openFile: null, // what is done with a dropped file; by default it is a panorama
  beforeReading: null, // called and awaited before a file of the user's own is read
  onFigure: null, // called when another figure is shown
  isOpening: false, // the light turns because the page has just opened
  isDragged: false, // by a pointer on the stage
  isPainting: false, // a mask, so that keys do not turn the light
};
const listeners = [];

// Calls `listener` after every change of the state.
function subscribe(listener) {
  listeners.push(listener);
}

const clamp = (value, low, high) => Math.min(Math.max(value, low), high);

// Changes the state; angles wrap around, everything else is kept within its bounds.
function set(changes) {
  Object.assign(state, changes);
  for (const name of ["yaw", "takenYaw"]) state[name] = ((((state[name] + 180) % 360) + 360) % 360) - 180;
  state.tilt = clamp(state.tilt, -90, 90);
  state.stops = clamp(state.stops, -3, 3);
  state.split = clamp(state.split, 0, 1);
  state.room = clamp(state.room, 0, 1);
  if (state.before === state.view) state.before = "none";
  for (const listener of listeners) listener();
}

export { DEFAULTS, app, clamp, element, embedded, page, set, state, subscribe };
