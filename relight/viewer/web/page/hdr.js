// Radiance .hdr files and their light, as relight/panoramas reads and projects them: RGBE, old and new run lengths,
// EXPOSURE, COLORCORR, all eight orientations; lat-long only. An Error's message is a sentence for the user.

import { Y0, Y1, Y2, Y20, Y22 } from "./sh.js";

const MAX_PIXELS = 2 ** 25, MAX_HEADER = 65536;
const EXR = [0x76, 0x2f, 0x31, 0x01]; // how an OpenEXR file begins
const NUMBERS = { EXPOSURE: 1, COLORCORR: 3, PRIMARIES: 8 }; // of a line of the header
const NEUTRAL = [[0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329], [0.64, 0.33, 0.29, 0.6, 0.15, 0.06, 1 / 3, 1 / 3], Array(8).fill(0)];

// Pixels, their size, and a note for the user, mostly empty.
export function readHDR(buffer) {
  let bytes = new Uint8Array(buffer), at = 0;
  if (bytes[0] === 0xef && bytes[1] === 0xbb && bytes[2] === 0xbf) bytes = bytes.subarray(3); // UTF-8's mark
  if (EXR.every((byte, i) => byte === bytes[i])) {
    throw new Error("OpenEXR panoramas are not read here: save it as Radiance .hdr.");
  }
  if (bytes[0] !== 0x23 || bytes[1] !== 0x3f) {
    throw new Error("This is not a Radiance .hdr file (it does not begin with #?).");
  }
  const line = () => {
    const end = bytes.indexOf(10, at);
    if (end < 0 || end > MAX_HEADER) throw new Error("The .hdr header does not end.");
    const text = new TextDecoder("latin1").decode(bytes.subarray(at, end)).trimEnd();
    at = end + 1;
    return text;
  };
  const divide = [1, 1, 1];
  let note = "";
  for (let text = line(); text !== ""; text = line()) {
    const [, name, value] = text.match(/^([A-Z]+)\s*=\s*(.*)$/) ?? [];
    if (name === "FORMAT" && value !== "32-bit_rle_rgbe") throw new Error(`The .hdr format ${value} is not RGBE.`);
    if (name === "GAMMA" && Number(value) !== 1) note = `Its GAMMA of ${value} is left out: pixels are taken as linear.`;
    if (!(name in NUMBERS)) continue;
    const numbers = value.split(/\s+/).map(Number), isColor = name === "PRIMARIES";
    if (numbers.length !== NUMBERS[name] || !numbers.every((n) => isFinite(n) && (isColor || n > 0))) {
      throw new Error(`The .hdr header has a bad ${name}.`);
    }
    if (!isColor) divide.forEach((_, c) => (divide[c] *= numbers[c % numbers.length]));
    else if (!NEUTRAL.some((known) => known.every((n, i) => Math.abs(n - numbers[i]) < 2e-3))) {
      throw new Error("The .hdr has PRIMARIES of another color space: save it in those of Rec. 709.");
    }
  }
  const size = line().match(/^([+-])([XY]) +(\d{1,9}) +([+-])([XY]) +(\d{1,9})$/);
  if (!size || size[2] === size[5]) throw new Error("The .hdr file has no valid line of resolution.");
  const rows = Number(size[3]), columns = Number(size[6]);
  if (!rows || !columns || rows * columns > MAX_PIXELS) {
    throw new Error(`An .hdr of ${columns} x ${rows} pixels is refused.`);
  }
  return { ...orient(readScanlines(bytes, at, rows, columns), rows, columns, size, divide), note };
}

function readScanlines(bytes, at, rows, columns) {
  const out = new Uint8Array(4 * rows * columns), truncated = () => new Error("The .hdr file is cut short or damaged.");
  if (bytes.length - at < 4 * rows) throw truncated();
  for (let row = 0; row < rows; row++) {
    const start = 4 * row * columns;
    const isNew = columns >= 8 && columns < 32768 && bytes[at] === 2 && bytes[at + 1] === 2 && bytes[at + 2] < 128;
    if (isNew) {
      if (bytes[at + 2] * 256 + bytes[at + 3] !== columns) throw truncated();
      at += 4;
      for (let channel = 0; channel < 4; channel++) {
        for (let x = 0; x < columns; ) {
          const code = bytes[at++], isRun = code > 128, run = isRun ? code - 128 : code;
          if (!run || x + run > columns || at + (isRun ? 1 : run) > bytes.length) throw truncated();
          for (let i = 0; i < run; i++) out[start + 4 * x++ + channel] = isRun ? bytes[at] : bytes[at + i];
          at += isRun ? 1 : run;
        }
      }
      continue;
    }
    for (let x = 0, shift = 0; x < columns; at += 4) {
      if (at + 4 > bytes.length) throw truncated();
      if (bytes[at] === 1 && bytes[at + 1] === 1 && bytes[at + 2] === 1) {
        const run = bytes[at + 3] * 2 ** shift, from = start + 4 * (x - 1);
        shift += 8;
        if (x === 0 || x + run > columns) throw truncated();
        for (let i = 0; i < run; i++) out.copyWithin(start + 4 * x++, from, from + 4);
      } else {
        out.set(bytes.subarray(at, at + 4), start + 4 * x++);
        shift = 0;
      }
    }
  }
  return out;
}

// Float RGB, row 0 at the top and column 0 at the left, from scanlines stored in the order that `size` tells.
function orient(scanlines, rows, columns, [, sign1, axis1, , sign2], divide) {
  const isRowFirst = axis1 === "Y", width = isRowFirst ? columns : rows, height = isRowFirst ? rows : columns;
  const pixels = new Float32Array(3 * width * height);
  for (let i = 0, k = 0; i < rows; i++) {
    for (let j = 0; j < columns; j++, k += 4) {
      const first = (sign1 === "+") === isRowFirst ? rows - 1 - i : i;
      const second = (sign2 === "+") === isRowFirst ? j : columns - 1 - j;
      const to = 3 * (isRowFirst ? first * width + second : second * width + first);
      const scale = scanlines[k + 3] ? 2 ** (scanlines[k + 3] - 136) : 0;
      for (let c = 0; c < 3; c++) pixels[to + c] = (scanlines[k + c] * scale) / divide[c];
    }
  }
  return { width, height, pixels };
}

// A lat-long panorama (centre -z, right +x) as 27 coefficients, by the exact integral of each basis function over each
// pixel: for x = sin(t) sin(p), y = cos(t), z = -sin(t) cos(p) it separates into a factor of the row and of the column.
export function project({ width, height, pixels }) {
  if (Math.abs(width - 2 * height) > 0.01 * width) throw new Error(`A panorama of ${width} x ${height} is not lat-long, which is 2:1.`);
  const difference = (f, edges) => edges.slice(1).map((e, i) => f(e) - f(edges[i]));
  const rowEdges = Array.from({ length: height + 1 }, (_, i) => (i / height) * Math.PI);
  const columnEdges = Array.from({ length: width + 1 }, (_, j) => (2 * j / width - 1) * Math.PI);
  const { sin, cos } = Math;
  const S = difference((t) => -cos(t), rowEdges); // integrals over t of sin(t) times 1, cos, sin, ...
  const SC = difference((t) => sin(t) ** 2 / 2, rowEdges);
  const SS = difference((t) => (t - sin(t) * cos(t)) / 2, rowEdges);
  const SCC = difference((t) => -(cos(t) ** 3) / 3, rowEdges);
  const SSC = difference((t) => sin(t) ** 3 / 3, rowEdges);
  const SSS = S.map((s, i) => s - SCC[i]);
  const one = difference((p) => p, columnEdges); // integrals over p
  const s = difference((p) => -cos(p), columnEdges), c = difference((p) => sin(p), columnEdges);
  const ss = difference((p) => (p - sin(p) * cos(p)) / 2, columnEdges);
  const cc = difference((p) => (p + sin(p) * cos(p)) / 2, columnEdges);
  const sc = difference((p) => sin(p) ** 2 / 2, columnEdges);
  const light = new Float64Array(27), sums = new Float64Array(18);
  const columnFactors = [one, s, c, ss, cc, sc];
  const trigonometry = Float64Array.from({ length: 6 * width }, (_, n) => columnFactors[n % 6][Math.floor(n / 6)]);
  for (let i = 0, k = 0; i < height; i++) {
    sums.fill(0);
    for (let j = 0; j < width; j++) {
      for (let channel = 0; channel < 3; channel++, k++) {
        const value = Math.max(pixels[k], 0);
        for (let f = 0; f < 6; f++) sums[3 * f + channel] += value * trigonometry[6 * j + f];
      }
    }
    for (let channel = 0; channel < 3; channel++) {
      const [m1, ms, mc, mss, mcc, msc] = [0, 3, 6, 9, 12, 15].map((f) => sums[f + channel]);
      const terms = [
        Y0 * S[i] * m1, Y1 * SC[i] * m1, -Y1 * SS[i] * mc, Y1 * SS[i] * ms, Y2 * SSC[i] * ms, -Y2 * SSC[i] * mc,
        Y20 * (3 * SSS[i] * mcc - S[i] * m1), -Y2 * SSS[i] * msc, Y22 * (SSS[i] * mss - SCC[i] * m1),
      ];
      for (let f = 0; f < 9; f++) light[3 * f + channel] += terms[f];
    }
  }
  return light;
}
