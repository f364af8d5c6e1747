// The edge of a mask, fitted to the photo's colors: relight/photos/mask/edge.py.

import { MASK_THRESHOLD } from "./crop.js";
import { extremes, means } from "./filters.js";
import { extent } from "./regions.js";

const CELLS = 400, SURE = 13, WINDOW = 7, PRIOR = 0.3, NOISE = 0.02, SPREAD = 5, STEEP = 1.1, ENOUGH = 1 / 30;
const HALF = 77, SOFT = 0.025;

// Coverage, a byte per pixel, of the people in a photo of three planes of linear values. A soft mask is the user's word.
function fitEdge(image, coverage, width) {
  if (isSoft(coverage, width)) return coverage;
  coverage = coverage.map((v) => (v >= MASK_THRESHOLD ? 255 : 0));
  const height = coverage.length / width, box = extent(coverage.map((v) => (v > SURE ? 1 : 0)), width);
  if (!box) return coverage;
  const side = Math.max(Math.round(Math.max(box.rows[1] - box.rows[0], box.columns[1] - box.columns[0]) / CELLS), 2);
  const grown = ([first, end], length) => [Math.max(first - WINDOW * side, 0), Math.min(end + WINDOW * side, length)];
  const [top, bottom] = grown(box.rows, height), [left, right] = grown(box.columns, width), wide = right - left, high = bottom - top;
  const cut = (plane) => {
    const part = new plane.constructor(wide * high);
    for (let y = 0; y < high; y++) part.set(plane.subarray((top + y) * width + left, (top + y) * width + right), y * wide);
    return part;
  };
  let share = cut(coverage);
  if (!share.some((v) => v > 0 && v < 255)) share = means(share, wide, 3, true);
  const across = Math.ceil(wide / side), down = Math.ceil(high / side), cells = across * down;
  const combine = (plane, how) => Float32Array.from({ length: cells }, (_, k) => {
    const y = Math.floor(k / across) * side, x = (k % across) * side;
    let value = null;
    for (let i = 0; i < side * side; i++) {
      const row = Math.min(y + Math.floor(i / side), high - 1), next = plane[row * wide + Math.min(x + (i % side), wide - 1)];
      value = value === null ? next : how(value, next);
    }
    return value;
  });
  const [low] = extremes(combine(share, Math.min), across, 3), [, most] = extremes(combine(share, Math.max), across, 3);
  const sure = [low.map((v) => (v > 255 - SURE ? 1 : 0)), most.map((v) => (v < SURE ? 1 : 0))];
  const seen = sure.map((set) => means(set, across, WINDOW, true));
  const trust = seen[0].map((v, k) => Math.min((v * seen[1][k]) / ENOUGH, 1) ** 2);
  const colors = image.map(cut), area = side * side;
  const near = colors.map((plane) => [plane, plane.map((v) => v * v)].map((values) => {
    const mean = combine(values, (a, b) => a + b).map((v) => v / area);
    return sure.map((set, n) =>
      means(mean.map((v, k) => v * set[k]), across, WINDOW, true).map((v, k) => v / Math.max(seen[n][k], 1e-4)));
  }));
  const out = coverage.slice();
  for (let i = 0; i < share.length; i++) {
    const x = i % wide, y = Math.floor(i / wide), place = (top + y) * width + left + x;
    const k = Math.floor(y / side) * across + Math.floor(x / side);
    out[place] = share[i];
    if (sure[0][k] || sure[1][k] || trust[k] <= 1e-3) continue;
    let along = 0, span = 0, variance = 0;
    near.forEach(([[front, behind], squares], c) => {
      const step = front[k] - behind[k], away = colors[c][i] - behind[k];
      along += away * step;
      span += step * step;
      variance += Math.max(squares[0][k] - front[k] ** 2, 0) + Math.max(squares[1][k] - behind[k] ** 2, 0);
    });
    const doubt = (NOISE ** 2 + SPREAD * variance) / (PRIOR ** 2 * trust[k]);
    const fitted = (along + (doubt * share[i]) / 255) / (span + doubt);
    out[place] = Math.round(255 * Math.min(Math.max((fitted - 0.5) * STEEP + 0.5, 0), 1));
  }
  return out;
}

// Whether the mask has fractional values along its edge, more than coders leave in two values.
function isSoft(coverage, width) {
  const [low, high] = extremes(coverage, width, 3);
  let along = 0, fractional = 0;
  for (let i = 0; i < coverage.length; i++) {
    if (high[i] < MASK_THRESHOLD || low[i] >= MASK_THRESHOLD) continue;
    along++;
    if (coverage[i] > HALF && coverage[i] < 255 - HALF) fractional++;
  }
  return fractional > SOFT * along;
}

// Whether an alpha may be a mask: solid somewhere, and neither everywhere nor along most of the photo's edges, as with
// rounded corners (relight/photos/mask/find.py).
function hasOutline(alpha, width) {
  const share = (values) => values.filter((v) => v >= MASK_THRESHOLD).length / values.length;
  const top = alpha.subarray(0, width), side = (x) => alpha.filter((_, i) => i % width === x);
  const edges = [...top, ...alpha.subarray(-width), ...side(0), ...side(width - 1)];
  return share(alpha) > 0 && share(alpha) < 1 && !(share(edges) > 0.6 && share(top) > 0.5);
}

export { fitEdge, hasOutline, isSoft };
