// The light of a place, from a photograph of it, and that photograph behind a figure: relight/lights/place.py and
// relight/photos/background.py. A picture is { pixels, width, height }, RGBA bytes in sRGB.

import { decodeSRGB } from "./figure.js";
import { box, resample } from "./resample.js";
import { COSINE } from "./sh.js";

const SIDE = 48, TINT = 0.5, WHITE = 0.98, FLOOR = 1e-3; // of place.py
const SAMPLED = 40000, LEAST_CHANNEL = 0.2; // of background.py
const LINEAR = Float32Array.from({ length: 256 }, (_, code) => decodeSRGB(code / 255));
const luminance = ([r, g, b]) => 0.2126 * r + 0.7152 * g + 0.0722 * b;
const mean = (values) => values.reduce((sum, value) => sum + value, 0) / values.length;

// The picture's linear colors [r, g, b], its longer side scaled down to SIDE pixels by averaging.
function thumbnail({ pixels, width, height }) {
  const scale = Math.min(SIDE / Math.max(width, height), 1);
  const size = [width, height].map((side) => Math.max(Math.round(side * scale), 1));
  const planes = [0, 1, 2].map((c) => {
    const plane = Uint8Array.from({ length: width * height }, (_, i) => pixels[4 * i + c]);
    return scale < 1 ? resample(plane, width, size, box) : plane;
  });
  return { size, colors: Array.from(planes[0], (_, i) => planes.map((plane) => LINEAR[plane[i]])) };
}

// What the light depends on: balance to the right and to the top, share of clipped pixels, contrast, ln(R/G), ln(B/G).
function features({ size: [width, height], colors }, color) {
  const light = colors.map(luminance), level = Math.max(mean(light), FLOOR);
  const at = (i, count) => (count > 1 ? (2 * i) / (count - 1) - 1 : 0);
  const across = light.map((value, i) => value * at(i % width, width));
  const up = light.map((value, i) => -value * at(Math.floor(i / width), height));
  const deviation = Math.sqrt(mean(light.map((value) => (value - mean(light)) ** 2)));
  const [red, green, blue] = color.map(Math.log);
  return [
    mean(across) / level, mean(up) / level, mean(colors.map((rgb) => (Math.max(...rgb) > WHITE ? 1 : 0))),
    Math.log(Math.max(deviation / level, FLOOR)), red - green, blue - green,
  ];
}

// The 27 coefficients of the light of the place in a picture; known: place.json.
function placeLight(picture, { light, limits, level }) {
  const small = thumbnail(picture), color = [0, 1, 2].map((c) => Math.max(mean(small.colors.map((rgb) => rgb[c])), FLOOR));
  const tint = color.map((value) => (value / luminance(color)) ** TINT);
  const weights = [1, ...features(small, color).map((value, i) => Math.min(Math.max(value, limits[i][0]), limits[i][1]))];
  const shape = Float64Array.from({ length: 27 }, (_, i) =>
    tint[i % 3] * weights.reduce((sum, weight, f) => sum + weight * light[f][i], 0));
  const norm = Math.hypot(...shape.map((value, i) => value * COSINE[Math.floor(i / 3)]));
  return shape.map((value) => (value * level * Math.max(mean(small.colors.map(luminance)), FLOOR)) / norm);
}

// The color of the light in a picture, by "shades of grey".
function whiteOf({ pixels, width, height }) {
  const every = Math.max(Math.trunc(Math.sqrt((width * height) / SAMPLED)), 1), sums = [0, 0, 0];
  for (let y = 0; y < height; y += every) {
    for (let x = 0; x < width; x += every) sums.forEach((_, c) => (sums[c] += LINEAR[pixels[4 * (y * width + x) + c]] ** 6));
  }
  return sums.map((sum) => (sum / (Math.ceil(width / every) * Math.ceil(height / every))) ** (1 / 6));
}

// A color of luminance 1, with no channel below a fifth.
const hue = (color) => color.map((value) => Math.max(value / Math.max(luminance(color), 1e-6), LEAST_CHANNEL));

// The factors on a picture's linear colors that bring its white halfway to that of a light.
function tintOf(white, light) {
  const [wanted, had] = [[0, 1, 2].map((c) => Math.max(light[c], 0)), white].map(hue);
  return wanted.map((value, c) => Math.sqrt(value / had[c]));
}

export { hue, luminance, placeLight, tintOf, whiteOf };
