// The page's address holds its state, so that a link shows what was seen.

import { DEFAULTS, app, state } from "./state.js";

const DELAY = 300; // milliseconds of rest before the address is written: browsers limit how often it may change
const NUMBERS = ["yaw", "tilt", "stops", "split", "room", "takenYaw"];
const WORDS = ["view", "before", "background", "color", "mode", "taken"];
const rounded = (value) => String(Math.round(value * 1000) / 1000);
let timer = null;

// The part of the state that differs from the page's own, as URL parameters; `first` is the background it opens with.
function toParameters(first) {
  const parameters = new URLSearchParams(), light = app.shown[state.light];
  if (app.index) parameters.set("figure", app.index);
  if (state.light) parameters.set("light", light.name);
  if (light.isOwn) parameters.set("sh", [...light.values].map((value) => value.toPrecision(4)).join(","));
  for (const name of NUMBERS) if (state[name] !== DEFAULTS[name]) parameters.set(name, rounded(state[name]));
  for (const name of WORDS) {
    const usual = name === "background" ? first : DEFAULTS[name];
    if (state[name] !== usual) parameters.set(name, state[name]);
  }
  const lamps = state.lamps.map(({ azimuth, elevation, color, strength, softness }) =>
    [azimuth, elevation, strength, softness].map(rounded).join(",") + color);
  if (lamps.length) parameters.set("lamps", lamps.join(";"));
  return parameters;
}

// The changes of the state that an address asks for; what it has wrong is passed over. Figure and own light, which are
// loaded first, come apart.
function fromAddress(hash) {
  const parameters = new URLSearchParams(hash.replace(/^#/, "")), changes = {};
  for (const name of NUMBERS) {
    const value = Number(parameters.get(name) ?? NaN);
    if (Number.isFinite(value)) changes[name] = value;
  }
  for (const name of WORDS) if (parameters.has(name)) changes[name] = parameters.get(name);
  if (changes.color && !/^#[0-9a-f]{6}$/i.test(changes.color)) delete changes.color;
  const lamp = /^([-.\d]+),([-.\d]+),([.\d]+),([.\d]+)(#[0-9a-f]{6})$/i;
  const lamps = (parameters.get("lamps") ?? "").split(";").map((text) => text.match(lamp)).filter(Boolean);
  if (lamps.length) {
    changes.lamps = lamps.map(([, azimuth, elevation, strength, softness, color]) => ({
      azimuth: +azimuth, elevation: +elevation, strength: +strength, softness: +softness, color,
    }));
  }
  const sh = (parameters.get("sh") ?? "").split(",").map(Number);
  return {
    changes,
    figure: Number(parameters.get("figure") ?? 0),
    light: parameters.get("light"),
    own: sh.length === 27 && sh.every(Number.isFinite) ? Float64Array.from(sh) : null,
  };
}

function writeAddress(first) {
  clearTimeout(timer);
  timer = setTimeout(() => {
    if (state.auto) return;
    const text = toParameters(first).toString();
    history.replaceState(null, "", text ? `#${text}` : location.pathname + location.search);
  }, DELAY);
}

export { fromAddress, toParameters, writeAddress };
