// The square that the network sees of a photo, and the way back: relight/maps/square.py.

import { bicubic, bilinear, resample } from "../page/resample.js";
import { extent } from "./regions.js";

const MASK_THRESHOLD = 128; // coverage (of 255) from which a pixel counts as the person's
const PADDING = 0.05; // of the square's side, around the figure

class Crop {
  // coverage: a plane of bytes, `width` pixels wide, with something solid in it; size: of the network's image.
  constructor(coverage, width, size) {
    const height = coverage.length / width, solid = extent(coverage.map((v) => (v >= MASK_THRESHOLD ? 1 : 0)), width);
    const [rows, columns] = [solid.rows, solid.columns], whole = extent(coverage, width);
    this.side = Math.max(rows[1] - rows[0], columns[1] - columns[0]) / (1 - 2 * PADDING);
    [this.top, this.left] = [rows, columns].map(([first, end]) => (first + end - this.side) / 2);
    const near = ([first, end], start) =>
      [Math.max(first, Math.trunc(start - this.side / 2)), Math.min(end, Math.trunc(start + 1.5 * this.side) + 1)];
    Object.assign(this, { width, height, size, rows: near(whole.rows, this.top), columns: near(whole.columns, this.left) });
  }

  // [left, top, width, height] of the part of the photo that `place` fills.
  get window() {
    return [this.columns[0], this.rows[0], this.columns[1] - this.columns[0], this.rows[1] - this.rows[0]];
  }

  // The square of a plane of the photo, whose values are value(i); what lies outside the photo is 0.
  extract(value) {
    const top = Math.floor(this.top) - 1, left = Math.floor(this.left) - 1, reach = Math.ceil(this.side) + 3;
    const canvas = new Float32Array(reach * reach);
    for (let y = Math.max(top, 0); y < Math.min(top + reach, this.height); y++) {
      for (let x = Math.max(left, 0); x < Math.min(left + reach, this.width); x++) {
        canvas[(y - top) * reach + x - left] = value(y * this.width + x);
      }
    }
    const [x, y] = [this.left - left, this.top - top];
    return resample(canvas, reach, [this.size, this.size], bilinear, [x, y, x + this.side, y + this.side]);
  }

  // A plane of the square at the photo's pixels in `window`.
  place(plane, isCubic = true) {
    const { size, side } = this, scale = size / side, [columns, rows] = [this.columns, this.rows];
    const low = Math.min(rows[0] - this.top, columns[0] - this.left);
    const high = Math.max(rows[1] - this.top, columns[1] - this.left) - side;
    const margin = Math.max(Math.ceil(Math.max(-low, high) * scale), 0) + 2, wide = size + 2 * margin;
    const padded = new Float32Array(wide * wide), held = (i) => Math.min(Math.max(i - margin, 0), size - 1);
    for (let y = 0, k = 0; y < wide; y++) for (let x = 0; x < wide; x++, k++) padded[k] = plane[held(y) * size + held(x)];
    const edges = [columns[0] - this.left, rows[0] - this.top, columns[1] - this.left, rows[1] - this.top];
    const part = edges.map((edge) => edge * scale + margin), [, , width, height] = this.window;
    return resample(padded, wide, [width, height], scale < 1 && isCubic ? bicubic : bilinear, part);
  }
}

export { Crop, MASK_THRESHOLD };
