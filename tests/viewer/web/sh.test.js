import assert from "node:assert/strict";
import { test } from "node:test";

import { fromMap, lampLight, onMap } from "../../../relight/viewer/web/page/lamps.js";
import { COSINE, basis, deringed, rotate, turn } from "../../../relight/viewer/web/page/sh.js";

const light = Float64Array.from({ length: 27 }, (_, i) => (i < 3 ? 1 : Math.sin(3 * i) / 3));
const directions = Array.from({ length: 500 }, (_, i) => {
  const z = 1 - (2 * i + 1) / 500, side = Math.sqrt(1 - z * z);
  return [side * Math.cos(2.4 * i), side * Math.sin(2.4 * i), z];
});
const along = (values, d, factors = COSINE) =>
  [0, 1, 2].map((c) => basis(d).reduce((sum, y, k) => sum + factors[k] * y * values[3 * k + c], 0));
const apply = (R, d) => R.map((row) => row.reduce((sum, value, i) => sum + value * d[i], 0));
const close = (a, b, tolerance = 1e-12) => a.forEach((value, i) => assert.ok(Math.abs(value - b[i]) <= tolerance, `${a} ${b}`));

test("rotate: light along a turned direction is the light along the direction", () => {
  const R = turn(0.7, -0.4), turned = rotate(light, R), ones = Array(9).fill(1);
  for (const d of directions) close(along(turned, apply(R, d), ones), along(light, d, ones));
});

test("deringed: a lamp's irradiance is nowhere negative, and its hue is one everywhere", () => {
  const lamp = Float64Array.from(basis([0.48, 0.6, 0.64]).flatMap((y) => [y, 0.6 * y, 0.2 * y])), found = deringed(lamp);
  assert.ok(Math.min(...directions.map((d) => along(lamp, d)[0])) < -0.03);
  for (const d of directions) {
    const [red, green, blue] = along(found, d);
    assert.ok(red > 0);
    close([green, blue], [0.6 * red, 0.2 * red]);
  }
  close(deringed(found), found);
});

test("deringed: soft and black light stay as they are", () => {
  const soft = light.map((value, i) => (i < 3 ? 2 : value / 10));
  assert.equal(deringed(soft).join(), soft.join());
  assert.equal(deringed(new Float64Array(27)).join(), new Float64Array(27).join());
});

test("lampLight: softer lamps have the same mean and less of the other bands", () => {
  const lamp = { azimuth: 30, elevation: 20, color: "#ff8800", strength: 2 };
  const [hard, soft] = [0, 60].map((softness) => lampLight({ ...lamp, softness }, 0.5));
  close(hard.slice(0, 3), soft.slice(0, 3));
  for (let k = 3; k < 27; k += 3) assert.ok(Math.abs(soft[k]) < Math.abs(hard[k]));
});

test("fromMap undoes onMap", () => {
  for (const lamp of [[0, 0], [90, 10], [-120, -40], [45, 80]].map(([azimuth, elevation]) => ({ azimuth, elevation }))) {
    const found = fromMap(...onMap(lamp));
    close([found.azimuth, found.elevation], [lamp.azimuth, lamp.elevation], 1e-9);
  }
});
