// Colors of a photo: relight/photos/tone.py and render.py. Pictures are three planes of linear values.

import { decodeSRGB } from "../page/figure.js";
import { means } from "./filters.js";
import { extent } from "./regions.js";

const LINEAR = Float32Array.from({ length: 256 }, (_, code) => decodeSRGB(code / 255));
const CLIPPING = LINEAR[235], MAX_EXCESS = 0.6;
const WIDE = 45, NARROW = 6;

// The three planes of linear values of a photo.
function linearPlanes({ pixels }) {
  return [0, 1, 2].map((c) => Float32Array.from({ length: pixels.length / 4 }, (_, i) => LINEAR[pixels[4 * i + c]]));
}

const clippedShare = (linear) => {
  const t = Math.min(Math.max((linear - CLIPPING) / (1 - CLIPPING), 0), 1);
  return t * t * (3 - 2 * t);
};

// The color, summing to 1, that bright things have about each pixel, as three planes.
function chroma(image, mask, width) {
  const height = mask.length / width;
  const weight = Float32Array.from(mask, (inside, i) => {
    const top = Math.max(image[0][i], image[1][i], image[2][i]);
    return inside ? top ** 4 * (1 - clippedShare(top)) : 0;
  });
  const sum = (i) => Math.max(image[0][i] + image[1][i] + image[2][i], 1e-6);
  const weighted = image.map((plane) => weight.map((w, i) => (w * plane[i]) / sum(i)));
  const found = image.map(() => new Float32Array(mask.length).fill(1 / 3));
  for (const wide of [2 * height, height >> 2, height >> 4, height >> 6]) {
    const size = Math.max(wide | 1, 3), total = means(weight, width, size);
    weighted.forEach((plane, c) => {
      const mean = means(plane, width, size);
      for (let i = 0; i < total.length; i++) {
        found[c][i] = (Math.max(mean[i], 0) + 3e-3 * found[c][i]) / (Math.max(total[i], 0) + 3e-3);
      }
    });
  }
  return found;
}

// By which share the light was above the values of one pixel (r, g, b) where these are clipped; `color`: its chroma.
function clippingExcess(linear, color) {
  const clipped = linear.map(clippedShare), kept = color.map((value, c) => (1 - clipped[c]) * value);
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const least = 2e-2 * Math.max(...linear.map((value, c) => value / Math.max(color[c], 1e-3)));
  const amount = (dot(kept, linear) + least) / (dot(kept, color) + 2e-2);
  return linear.map((value, c) => {
    const above = Math.max((color[c] * amount) / Math.max(value, 1e-3) - 1, 0);
    return clipped[c] * MAX_EXCESS * (1 - Math.exp(-above / MAX_EXCESS));
  });
}

// The figure's own color at each pixel of a photo whose coverage, of 255, is `coverage` (Forte 2021).
function estimateForeground(image, coverage, width) {
  const soft = coverage.map((v) => (v > 0 && v < 255 ? 1 : 0)), box = extent(soft, width), height = soft.length / width;
  if (!box) return image;
  const grown = ([first, end], length) => [Math.max(first - WIDE - NARROW, 0), Math.min(end + WIDE + NARROW, length)];
  const [top, bottom] = grown(box.rows, height), [left, right] = grown(box.columns, width), wide = right - left;
  const cut = (plane) => {
    const part = new Float32Array(wide * (bottom - top));
    for (let y = top; y < bottom; y++) part.set(plane.subarray(y * width + left, y * width + right), (y - top) * wide);
    return part;
  };
  const share = cut(Float32Array.from(coverage, (v) => v / 255)), rest = share.map((a) => 1 - a);
  const blurred = (plane, of, radius) => means(plane.map((v, i) => v * of[i]), wide, 2 * radius + 1, true);
  return image.map((plane) => {
    const near = cut(plane), out = plane.slice();
    let figure = near, behind = near;
    for (const radius of [WIDE, NARROW]) {
      const whole = means(share, wide, 2 * radius + 1, true), others = means(rest, wide, 2 * radius + 1, true);
      const own = blurred(figure, share, radius).map((v, i) => v / Math.max(whole[i], 1e-4));
      behind = blurred(behind, rest, radius).map((v, i) => v / Math.max(others[i], 1e-4));
      figure = own.map((v, i) => {
        const whole = v + share[i] * (near[i] - share[i] * v - rest[i] * behind[i]);
        return Math.min(Math.max(whole, 0), near[i] / Math.max(share[i], 1e-4));
      });
    }
    for (let y = top, k = 0; y < bottom; y++) {
      for (let x = left; x < right; x++, k++) if (soft[y * width + x]) out[y * width + x] = figure[k];
    }
    return out;
  });
}

export { CLIPPING, chroma, clippingExcess, estimateForeground, linearPlanes };
