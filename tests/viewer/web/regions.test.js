import assert from "node:assert/strict";
import { test } from "node:test";

import { extremes, means } from "../../../relight/viewer/web/studio/filters.js";
import { extent, label, nearest } from "../../../relight/viewer/web/studio/regions.js";
import { bicubic, bilinear, box, lanczos, resample } from "../../../relight/viewer/web/page/resample.js";

const width = 13, height = 9;
const plane = Float64Array.from({ length: width * height }, (_, i) => Math.sin(i * 12.9) * 5);
const set = Uint8Array.from(plane, (value) => (value > 2.5 ? 1 : 0));
const place = (i) => [i % width, Math.floor(i / width)];

test("nearest: no pixel of the set is nearer", () => {
  const distance = (i, j) => Math.hypot(...place(i).map((value, axis) => value - place(j)[axis]));
  nearest(set, width).forEach((found, i) => {
    assert.ok(set[found]);
    const least = Math.min(...[...set.keys()].filter((j) => set[j]).map((j) => distance(i, j)));
    assert.equal(distance(i, found), least);
  });
  assert.ok(nearest(new Uint8Array(6), 3).every((value) => value === -1));
});

test("label: parts are counted with and without diagonals", () => {
  const diagonal = Uint8Array.from([1, 0, 0, 0, 1, 0, 0, 0, 1]);
  assert.deepEqual(label(diagonal, 3).areas, [0, 1, 1, 1]);
  assert.deepEqual(label(diagonal, 3, true).areas, [0, 3]);
});

test("extent: the box of a set, and null for none", () => {
  const one = new Uint8Array(width * height);
  one[3 * width + 4] = one[5 * width + 2] = 1;
  assert.deepEqual(extent(one, width), { rows: [3, 6], columns: [2, 5] });
  assert.equal(extent(new Uint8Array(4), 2), null);
});

test("means and extremes: as loops over windows have them", () => {
  const [low, high] = extremes(plane, width, 3), mean = means(plane, width, 3, true);
  plane.forEach((_, i) => {
    const [x, y] = place(i), near = [], padded = [];
    for (let dy = -1; dy <= 1; dy++) {
      for (let dx = -1; dx <= 1; dx++) {
        const at = (v, most) => Math.min(Math.max(v, 0), most - 1);
        padded.push(plane[at(y + dy, height) * width + at(x + dx, width)]);
        if (x + dx >= 0 && x + dx < width && y + dy >= 0 && y + dy < height) near.push(plane[(y + dy) * width + x + dx]);
      }
    }
    assert.equal(low[i], Math.min(...near));
    assert.equal(high[i], Math.max(...near));
    assert.ok(Math.abs(mean[i] - padded.reduce((sum, v) => sum + v, 0) / 9) < 1e-12);
  });
});

test("resample: an even plane stays even, and the same size stays as it is", () => {
  for (const filter of [bilinear, bicubic, box, lanczos]) {
    const even = resample(new Float64Array(plane.length).fill(3), width, [7, 20], filter);
    assert.ok(even.every((value) => Math.abs(value - 3) < 1e-12));
  }
  assert.ok(resample(plane, width, [width, height], bilinear).every((value, i) => Math.abs(value - plane[i]) < 1e-12));
});
