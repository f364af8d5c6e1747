import assert from "node:assert/strict";
import { test } from "node:test";

import { project } from "../../../relight/viewer/web/page/hdr.js";
import { isPicture } from "../../../relight/viewer/web/page/photo.js";

const white = (width, height) => project({ width, height, pixels: new Float32Array(3 * width * height).fill(1) });

test("project: white light has its mean alone, at an aspect of 2:1 within 1 %, as in Python", () => {
  for (const size of [[64, 32], [201, 100], [199, 100]]) {
    white(...size).forEach((value, i) => assert.ok(Math.abs(value - (i < 3 ? 2 * Math.sqrt(Math.PI) : 0)) < 1e-6));
  }
  assert.throws(() => white(205, 100), /not lat-long/);
});

test("isPicture: files of panoramas are none, whatever the system calls their type", () => {
  const kinds = { "a.png": true, "a.hdr.jpg": true, "a.hdr": false, "A.EXR": false, "a.xyze": false };
  for (const [name, expected] of Object.entries(kinds)) assert.equal(isPicture({ name, type: "image/x" }), expected);
});
