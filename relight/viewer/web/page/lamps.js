// Lamps: distant discs of light that are added to the room's. {azimuth, elevation} in degrees, as in key:#RRGGBB@45,30
// of relight/lights/load.py; strength as a multiple of the room's mean irradiance; softness, the disc's angular radius.

import { decodeSRGB } from "./figure.js";
import { basis, deringed } from "./sh.js";

const RADIANS = Math.PI / 180;
const NEW_LAMP = Object.freeze({ azimuth: -50, elevation: 35, color: "#ffd9a8", strength: 1, softness: 10 });

// Unit vector toward a lamp: +x right, +y up, +z toward the viewer.
function toward({ azimuth, elevation }) {
  const a = azimuth * RADIANS, e = elevation * RADIANS;
  return [Math.sin(a) * Math.cos(e), Math.sin(e), Math.cos(a) * Math.cos(e)];
}

function linearColor(color) {
  return [1, 3, 5].map((i) => decodeSRGB(parseInt(color.slice(i, i + 2), 16) / 255));
}

// The 27 coefficients of a lamp whose irradiance on a surface that faces it is `irradiance` times its linear color.
// A disc of angular radius r scales the bands of a point by 1, (1 + cos r) / 2 and cos r (1 + cos r) / 2;
// a window keeps the shaded side from ringing below zero.
function lampLight(lamp, irradiance) {
  const c = Math.cos(lamp.softness * RADIANS), bands = [1, (1 + c) / 2, (c * (1 + c)) / 2];
  const rgb = linearColor(lamp.color), light = new Float64Array(27);
  basis(toward(lamp)).forEach((value, k) => {
    const scale = lamp.strength * irradiance * value * bands[Math.floor(Math.sqrt(k))];
    for (let channel = 0; channel < 3; channel++) light[3 * k + channel] = scale * rgb[channel];
  });
  return deringed(light);
}

// Where a lamp is drawn on a round map of all directions: (0, 0) in front of the figure, radius 1/2 beside, above and
// below it, radius 1 behind it.
function onMap(lamp) {
  const [x, y, z] = toward(lamp), side = Math.hypot(x, y) || 1, radius = Math.acos(Math.min(Math.max(z, -1), 1)) / Math.PI;
  return [(radius * x) / side, (-radius * y) / side];
}

// The inverse of `onMap`; points outside of the map are taken to its rim.
function fromMap(x, y) {
  const radius = Math.min(Math.hypot(x, y), 1), angle = radius * Math.PI, side = Math.hypot(x, y) || 1;
  const direction = [(Math.sin(angle) * x) / side, (-Math.sin(angle) * y) / side, Math.cos(angle)];
  return {
    azimuth: Math.atan2(direction[0], direction[2]) / RADIANS,
    elevation: Math.asin(Math.min(Math.max(direction[1], -1), 1)) / RADIANS,
  };
}

export { NEW_LAMP, fromMap, lampLight, onMap };
