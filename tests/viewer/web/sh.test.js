import assert from "node:assert/strict";
import { test } from "node:test";

import { fromMap, onMap } from "../../../relight/viewer/web/page/lamps.js";
import { basis, rotate, turn } from "../../../relight/viewer/web/page/sh.js";

const light = Float64Array.from({ length: 27 }, (_, i) => (i < 3 ? 1 : Math.sin(3 * i) / 3));
const directions = Array.from({ length: 500 }, (_, i) => {
  const z = 1 - (2 * i + 1) / 500, side = Math.sqrt(1 - z * z);
  return [side * Math.cos(2.4 * i), side * Math.sin(2.4 * i), z];
});
const along = (values, d) => [0, 1, 2].map((c) => basis(d).reduce((sum, y, k) => sum + y * values[3 * k + c], 0));
const apply = (R, d) => R.map((row) => row.reduce((sum, value, i) => sum + value * d[i], 0));
const close = (a, b, tolerance = 1e-12) => a.forEach((value, i) => assert.ok(Math.abs(value - b[i]) <= tolerance, `${a} ${b}`));

test("rotate: light along a turned direction is the light along the direction", () => {
  const R = turn(0.7, -0.4), turned = rotate(light, R);
  for (const d of directions) close(along(turned, apply(R, d)), along(light, d));
});

test("fromMap undoes onMap", () => {
  for (const lamp of [[0, 0], [90, 10], [-120, -40], [45, 80]].map(([azimuth, elevation]) => ({ azimuth, elevation }))) {
    const found = fromMap(...onMap(lamp));
    close([found.azimuth, found.elevation], [lamp.azimuth, lamp.elevation], 1e-9);
  }
});
