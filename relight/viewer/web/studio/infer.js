// From a photo and its mask to a figure for the viewer: relight/photos/person.py and relight/viewer/source.py. A photo is
// {pixels, width, height} with RGBA bytes; coverage has a byte per pixel.

import { textures } from "../page/figure.js";
import { onWhite } from "../page/photo.js";
import { CLIPPING, chroma, clippingExcess, estimateForeground, linearPlanes } from "./colors.js";
import { Crop, MASK_THRESHOLD } from "./crop.js";
import { fitEdge } from "./edges.js";
import { Guide } from "./guided.js";
import { extent, label, nearest } from "./regions.js";

const OPAQUE = 240; // coverage from which a pixel shows hardly anything but the figure
const SHARE = 0.05; // of the largest person's area: smaller parts belong to the nearest person
const MIN_SIZE = 8; // pixels: a figure smaller than this in both directions is dirt
const FLOOR = 0.1; // of the mean old shading, under which it is not divided by
const LEAST = 0.2; // of the luminance: no channel of the light's color is divided by less
const MARGIN = 2; // pixels around the figure
const LUMA = [0.2126, 0.7152, 0.0722];

// One coverage for each person, from left to right; empty when the mask holds nobody.
function splitPeople(coverage, width) {
  const { labels, areas } = label(coverage.map((v) => (v >= MASK_THRESHOLD ? 1 : 0)), width, true), largest = Math.max(...areas);
  const found = areas.flatMap((area, number) => {
    if (!number || area < SHARE * largest) return [];
    const part = labels.map((n) => (n === number ? 1 : 0)), { rows, columns } = extent(part, width);
    if (Math.max(rows[1] - rows[0], columns[1] - columns[0]) < MIN_SIZE) return [];
    const filled = new Set();
    part.forEach((inside, i) => inside && filled.add(i % width));
    return [{ number, middle: [...filled].reduce((sum, x) => sum + x, 0) / filled.size }];
  });
  if (found.length < 2) return found.map(() => coverage);
  const numbers = found.sort((a, b) => a.middle - b.middle).map(({ number }) => number);
  const owner = nearest(labels.map((n) => (numbers.includes(n) ? 1 : 0)), width);
  return numbers.map((number) => coverage.map((v, i) => (labels[owner[i]] === number ? v : 0)));
}

// The square as the network sees it: three planes of linear values, 0 outside the mask, and the mask.
function networkInput(crop, image, coverage) {
  const seen = crop.extract((i) => coverage[i]), top = seen.reduce((most, v) => Math.max(most, v), 0);
  const mask = Uint8Array.from(seen, (v) => (v >= Math.min(MASK_THRESHOLD, top) ? 1 : 0));
  const square = image.map((plane) => {
    const sums = crop.extract((i) => plane[i] * coverage[i]);
    return sums.map((value, i) => (mask[i] ? Math.min(Math.max(value / Math.max(seen[i], 1e-3), 0), 1) : 0));
  });
  return { square, mask };
}

// What the network infers of one person, on its square; scale: pixels of the photo to one of the square. run: (image,
// mask) -> {albedo, transport, light}, flat.
async function inferPerson(image, width, coverage, run, size) {
  const crop = new Crop(coverage, width, size), { square, mask } = networkInput(crop, image, coverage), area = size * size;
  const images = new Float32Array(3 * area);
  square.forEach((plane, c) => images.set(plane, c * area));
  const found = await run(images, Float32Array.from(mask)), scale = (crop.side / size) ** 2;
  const planes = (values, count) => Array.from({ length: count }, (_, c) => values.subarray(c * area, (c + 1) * area));
  const albedo = planes(found.albedo, 3), transport = planes(found.transport, 9); // of a higher order, the lower bands
  const light = Array.from({ length: 9 }, (_, k) => [...found.light.subarray(3 * k, 3 * k + 3)]);
  return { coverage, crop, square, mask, albedo, transport, light, scale };
}

// The mean color of the light over the people, at luminance 1: white in the photo (balanced in relight/photos/person.py).
function meanColor(people) {
  const total = [0, 0, 0];
  for (const { mask, transport, light, scale } of people) {
    for (let i = 0; i < mask.length; i++) {
      for (let c = 0; mask[i] && c < 3; c++) total[c] += scale * shadingAt(transport, light, i, c);
    }
  }
  const level = Math.max(LUMA.reduce((sum, weight, c) => sum + weight * total[c], 0), 1e-6);
  return total.map((value) => Math.max(value / level, LEAST));
}

// The shading of pixel i in channel c.
function shadingAt(transport, light, i, c) {
  let sum = 0;
  for (let k = 0; k < 9; k++) sum += light[k][c] * transport[k][i];
  return Math.max(sum, 0);
}

// Writes a person's albedo and transport to planes of the whole photo, where they cover it.
function writeMaps(person, image, width, size, white, albedo, transport) {
  const { coverage, crop, square, mask } = person;
  const colors = new Guide(square.map((plane) => Float64Array.from(plane, Math.sqrt)), mask, size);
  const luma = (planes) => planes[0].map((_, i) => LUMA.reduce((sum, weight, c) => sum + weight * planes[c][i], 0));
  const grey = new Guide([luma(colors.values)], mask, size);
  const [left, top, wide, high] = crop.window;
  const places = Int32Array.from({ length: wide * high }, (_, i) => (top + Math.floor(i / wide)) * width + left + (i % wide));
  const detail = image.map((plane, c) => crop.place(colors.fillOutside(colors.values[c])).map((value, i) =>
    ((Math.sqrt(plane[places[i]]) - value) * Math.max(coverage[places[i]] - OPAQUE, 0)) / (255 - OPAQUE)));
  const write = (planes, placed, finish) => placed.forEach((plane, c) => plane.forEach((value, i) => {
    if (coverage[places[i]]) planes[c][places[i]] = finish(value);
  }));
  const roots = person.albedo.map((plane, c) => plane.map((value) => Math.sqrt(Math.max(value * white[c], 0))));
  write(albedo, colors.place(crop, roots, detail, true), (value) => value * value);
  write(transport, grey.place(crop, person.transport, [luma(detail)]), (value) => value);
}

// The figure as the viewer draws it (page/figure.js), or null when the mask holds nobody. size: of the network's image.
// isExact: whether the coverage is the photo's alpha, and no mask whose edge is to be fitted.
async function inferFigure(photo, given, run, size, isExact = false) {
  const { width, height } = photo, area = width * height, image = linearPlanes(photo);
  const coverage = isExact ? given : fitEdge(image, given, width);
  const planes = (count) => Array.from({ length: count }, () => new Float32Array(area));
  const albedo = planes(3), transport = planes(9), found = [];
  for (const person of splitPeople(coverage, width)) found.push(await inferPerson(image, width, person, run, size));
  if (!found.length) return null;
  const white = meanColor(found), areas = found.map(({ mask, scale }) => scale * mask.reduce((sum, v) => sum + v, 0));
  for (const person of found) writeMaps(person, image, width, size, white, albedo, transport);
  const total = areas.reduce((sum, area) => sum + area, 0);
  const light = Array.from({ length: 9 }, (_, k) => [0, 1, 2].map((c) =>
    found.reduce((sum, person, n) => sum + ((areas[n] / total) * person.light[k][c]) / white[c], 0)));
  const inside = Uint8Array.from(coverage, (v) => (v ? 1 : 0));
  return { width, height, light, ...summary(transport, light, inside), ...drawn(photo, coverage, inside, albedo, transport) };
}

// The mean transport over the figure, and the least shading to divide by.
function summary(transport, light, inside) {
  const mean = new Float64Array(9);
  let count = 0, shading = 0;
  for (let i = 0; i < inside.length; i++) {
    if (!inside[i]) continue;
    count++;
    for (let k = 0; k < 9; k++) mean[k] += transport[k][i];
    for (let c = 0; c < 3; c++) shading += shadingAt(transport, light, i, c);
  }
  return { mean: [...mean.map((value) => value / count)], floor: Math.max((FLOOR * shading) / (3 * count), 1e-4) };
}

// Arrays for textures, of the figure's box; the photo is on white.
function drawn({ pixels, width, height }, coverage, inside, albedo, transport) {
  const shown = onWhite(pixels);
  const image = linearPlanes({ pixels: shown, width, height });
  const { rows, columns } = extent(inside, width), [left, top] = [columns, rows].map(([first]) => Math.max(first - MARGIN, 0));
  const wide = Math.min(columns[1] + MARGIN, width) - left, high = Math.min(rows[1] + MARGIN, height) - top;
  const of = (i) => (top + Math.floor(i / wide)) * width + left + (i % wide), region = new Uint8Array(wide * high);
  const own = estimateForeground(image, coverage, width), front = new Float32Array(4 * region.length);
  let isClipped = false;
  for (let i = 0; i < region.length; i++) {
    region[i] = inside[of(i)];
    for (let c = 0; c < 3; c++) {
      front[4 * i + c] = own[c][of(i)];
      if (region[i] && front[4 * i + c] > CLIPPING) isClipped = true;
    }
  }
  let above = null;
  if (isClipped) {
    const colors = chroma(image, inside, width);
    above = new Uint8Array(4 * region.length);
    for (let i = 0; i < region.length; i++) {
      const linear = front.subarray(4 * i, 4 * i + 3);
      if (!region[i] || Math.max(...linear) <= CLIPPING) continue;
      const share = clippingExcess([...linear], colors.map((plane) => plane[of(i)]));
      share.forEach((value, c) => (above[4 * i + c] = Math.round(255 * value)));
    }
  }
  const maps = textures({
    transport: (k, i) => transport[k][of(i)],
    albedo: (c, i) => albedo[c][of(i)],
    coverage: (i) => coverage[of(i)] / 255,
  }, region, wide);
  return { box: [left, top, wide, high], maps, photo: shown, front, excess: above, hasNormals: false };
}

export { inferFigure, splitPeople };
