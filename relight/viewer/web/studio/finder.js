// Who is in a photo, by MediaPipe's network: relight/photos/mask/selfie.py.

import { means } from "./filters.js";
import { label, extent, nearest } from "./regions.js";
import { bicubic, bilinear, box, resample } from "../page/resample.js";

const WIDEST = 4 / 3; // width over height of what the network sees at a time
const SIDE = 256, PASSES = 3, MARGIN = 0.06; // of the network; its runs; around the figure, of its height
const SHARE = 0.05, NEAR = 0.01; // parts smaller than this of the largest, and farther from one kept, are dropped
const DETAIL = 900, WINDOW = 1 / 90, SMOOTH = 1e-4, STEEP = 1.6, BAND = 1 / 250; // of the edge's fit to the photo

const cut = (plane, width, [left, top, right, bottom]) => {
  const part = new plane.constructor((right - left) * (bottom - top));
  for (let y = top; y < bottom; y++) part.set(plane.subarray(y * width + left, y * width + right), (y - top) * (right - left));
  return part;
};

const paste = (plane, width, part, [left, top, right]) => {
  for (let k = 0, wide = right - left; k * wide < part.length; k++) {
    plane.set(part.subarray(k * wide, (k + 1) * wide), (top + k) * width + left);
  }
};

// What the network says about a part of the photo, in [0,1], SIDE x SIDE.
function predict(planes, width, part, run) {
  const area = SIDE * SIDE, image = new Float32Array(3 * area);
  planes.forEach((plane, c) => resample(plane, width, [SIDE, SIDE], bilinear, part).forEach((value, i) => {
    image[c * area + i] = value / 255;
  }));
  return run(image);
}

// The same about a part of any width, SIDE rows high, blended from windows that overlap.
async function predictWide(planes, width, [left, top, right, bottom], run) {
  const wide = right - left, window = Math.min(wide, Math.floor(WIDEST * (bottom - top) + 0.5));
  if (window === wide) return predict(planes, width, [left, top, right, bottom], run);
  const columns = Math.floor((wide * SIDE) / window + 0.5), total = new Float32Array(SIDE * columns), weights = new Float32Array(columns);
  const last = wide - window, count = 1 + Math.ceil(last / (window / 2));
  for (let n = 0; n < count; n++) {
    const start = (last * n) / (count - 1), first = left + Math.floor(start + 0.5), column = Math.floor((start * SIDE) / window + 0.5);
    const mask = await predict(planes, width, [first, top, first + window, bottom], run);
    for (let x = 0; x < SIDE; x++) {
      const weight = Math.min(x + 1, SIDE - x);
      weights[column + x] += weight;
      for (let y = 0; y < SIDE; y++) total[y * columns + column + x] += weight * mask[y * SIDE + x];
    }
  }
  return total.map((value, i) => value / weights[i % columns]);
}

const solid = (plane) => Uint8Array.from(plane, (value) => (value > 0.5 ? 1 : 0));

// `found`, SIDE rows high, without the parts that are small beside the largest and lie apart.
function dropSmallParts(found) {
  const width = found.length / SIDE, { labels, areas } = label(solid(found), width), largest = Math.max(...areas);
  if (areas.length < 3) return found;
  const closest = nearest(labels.map((n) => (n && areas[n] >= SHARE * largest ? 1 : 0)), width);
  const x = (i) => i % width, y = (i) => Math.floor(i / width);
  return found.map((value, i) => (Math.hypot(x(i) - x(closest[i]), y(i) - y(closest[i])) <= NEAR * SIDE ? value : 0));
}

// The part [left, top, right, bottom] that holds what is solid, with a margin; null where nothing is.
function boxAround(found, width) {
  const bounds = extent(solid(found), width), height = found.length / width;
  if (!bounds) return null;
  const { rows: [top, bottom], columns: [left, right] } = bounds, margin = Math.trunc(MARGIN * (bottom - top));
  return [Math.max(left - margin, 0), Math.max(top - margin, 0), Math.min(right + margin, width), Math.min(bottom + margin, height)];
}

// x of A x = b for a symmetric A = [[a, b, c], [b, d, e], [c, e, f]], by its adjugate.
function solve([a, b, c, d, e, f], [x, y, z]) {
  const A = d * f - e * e, B = c * e - b * f, C = b * e - c * d, determinant = a * A + b * B + c * C;
  const D = a * f - c * c, E = b * c - a * e, F = a * d - b * b;
  return [A * x + B * y + C * z, B * x + D * y + E * z, C * x + E * y + F * z].map((value) => value / determinant);
}

// The mask with its edges at those of the photo: a guided filter of the colors (He, Sun and Tang 2013).
function fitToEdges(planes, found, width) {
  const height = found.length / width, scale = Math.min(DETAIL / Math.max(width, height), 1);
  const size = [width, height].map((side) => Math.max(Math.round(side * scale), 1)), [wide] = size;
  const guide = planes.map((plane) => Float32Array.from(resample(plane, width, size, box), (v) => v / 255));
  const small = resample(found, width, size, bilinear);
  const reach = 2 * Math.max(Math.round(WINDOW * Math.max(...size)), 2) + 1, mean = (plane) => means(plane, wide, reach, true);
  const average = guide.map(mean), level = mean(small), product = (a, b) => mean(a.map((v, i) => v * b[i]));
  const pairs = [[0, 0], [0, 1], [0, 2], [1, 1], [1, 2], [2, 2]];
  const squares = pairs.map(([a, b]) => product(guide[a], guide[b])), along = guide.map((plane) => product(plane, small));
  const lines = Array.from({ length: 4 }, () => new Float32Array(small.length));
  for (let i = 0; i < small.length; i++) {
    const spread = pairs.map(([a, b], n) => squares[n][i] - average[a][i] * average[b][i] + (a === b ? SMOOTH : 0));
    const slope = solve(spread, along.map((plane, c) => plane[i] - average[c][i] * level[i]));
    slope.forEach((value, c) => (lines[c][i] = value));
    lines[3][i] = slope.reduce((rest, value, c) => rest - value * average[c][i], level[i]);
  }
  const [red, green, blue, offset] = lines.map((plane) => resample(mean(plane), wide, [width, height], bilinear));
  const edges = offset.map((value, i) => {
    const edge = value + (red[i] * planes[0][i] + green[i] * planes[1][i] + blue[i] * planes[2][i]) / 255;
    return Math.min(Math.max((edge - 0.5) * STEEP + 0.5, 0), 1);
  });
  return tighten(edges, width, Math.max(Math.round(BAND * Math.max(width, height)), 1));
}

// The mask opaque inside and empty outside, but for a band along its edge.
function tighten(mask, width, radius) {
  const share = means(Float32Array.from(solid(mask)), width, 2 * radius + 1, true), clamp = (value) => Math.min(Math.max(value, 0), 1);
  return mask.map((value, i) => Math.min(Math.max(value, clamp(2 * share[i] - 1)), clamp(2 * share[i])));
}

// Coverage, a byte per pixel, of the people in a photo; zero everywhere when the network sees nobody. run: image -> mask,
// flat.
async function findPeople({ pixels, width, height }, run) {
  const planes = [0, 1, 2].map((c) => Uint8Array.from({ length: width * height }, (_, i) => pixels[4 * i + c]));
  const found = new Float32Array(width * height);
  let part = [0, 0, width, height];
  for (let n = 0; n < PASSES && part; n++) {
    const size = [part[2] - part[0], part[3] - part[1]], seen = dropSmallParts(await predictWide(planes, width, part, run));
    found.fill(0);
    paste(found, width, resample(seen, seen.length / SIDE, size, bicubic).map((value) => Math.min(Math.max(value, 0), 1)), part);
    part = boxAround(found, width);
  }
  if (part) {
    const edges = fitToEdges(planes.map((plane) => cut(plane, width, part)), cut(found, width, part), part[2] - part[0]);
    paste(found, width, edges, part);
  }
  return Uint8Array.from(found, (value) => Math.round(value * 255));
}

export { findPeople };
