// Pillow's resampling: a separable filter, as wide as a pixel of the coarser grid, normalised at the borders.

const ONE = 2 ** 22; // a weight of 1 in Pillow's integers

const bilinear = { support: 1, weight: (x) => Math.max(1 - Math.abs(x), 0) };
const box = { support: 0.5, weight: (x) => (x > -0.5 && x <= 0.5 ? 1 : 0) };
const bicubic = {
  support: 2,
  weight: (signed) => {
    const x = Math.abs(signed), a = -0.5;
    if (x < 1) return ((a + 2) * x - (a + 3)) * x * x + 1;
    return x < 2 ? (((x - 5) * x + 8) * x - 4) * a : 0;
  },
};
const sinc = (x) => (x === 0 ? 1 : Math.sin(Math.PI * x) / (Math.PI * x));
const lanczos = { support: 3, weight: (x) => (x >= -3 && x < 3 ? sinc(x) * sinc(x / 3) : 0) };

// For each of `count` pixels that span [from, to) of `length` input pixels: the first that counts, and their weights.
function windows(length, from, to, count, filter) {
  const scale = (to - from) / count, wide = Math.max(scale, 1), support = filter.support * wide;
  return Array.from({ length: count }, (_, i) => {
    const center = from + (i + 0.5) * scale;
    const first = Math.max(Math.trunc(center - support + 0.5), 0);
    const last = Math.min(Math.trunc(center + support + 0.5), length);
    const weights = Float64Array.from({ length: last - first }, (_, x) => filter.weight((x + first - center + 0.5) * (1 / wide)));
    const sum = weights.reduce((total, weight) => total + weight, 0);
    return { first, weights: sum ? weights.map((weight) => weight * (1 / sum)) : weights };
  });
}

// One plane of numbers, `width` pixels wide, at another size. part: [left, top, right, bottom] of the input, numbers of
// single precision. The result has the type of the input; for bytes, weights and both passes are Pillow's integers.
function resample(plane, width, [newWidth, newHeight], filter, part = [0, 0, width, plane.length / width]) {
  const height = plane.length / width, [left, top, right, bottom] = part.map(Math.fround);
  const columns = windows(width, left, right, newWidth, filter), rows = windows(height, top, bottom, newHeight, filter);
  const isBytes = plane instanceof Uint8Array;
  const stored = isBytes ? (value) => Math.min(Math.max(Math.floor(value / ONE + 0.5), 0), 255) : (value) => value;
  if (isBytes) {
    for (const { weights } of [...columns, ...rows]) {
      weights.forEach((weight, i) => (weights[i] = Math.trunc(weight * ONE + (weight < 0 ? -0.5 : 0.5))));
    }
  }
  const begin = rows[0].first, end = rows.at(-1).first + rows.at(-1).weights.length;
  const between = new plane.constructor(newWidth * (end - begin)), out = new plane.constructor(newWidth * newHeight);
  for (let y = begin, k = 0; y < end; y++) {
    for (let x = 0; x < newWidth; x++, k++) {
      const { first, weights } = columns[x], from = y * width + first;
      let sum = 0;
      for (let i = 0; i < weights.length; i++) sum += weights[i] * plane[from + i];
      between[k] = stored(sum);
    }
  }
  for (let y = 0, k = 0; y < newHeight; y++) {
    const { first, weights } = rows[y], from = (first - begin) * newWidth;
    for (let x = 0; x < newWidth; x++, k++) {
      let sum = 0;
      for (let i = 0; i < weights.length; i++) sum += weights[i] * between[from + i * newWidth + x];
      out[k] = stored(sum);
    }
  }
  return out;
}

export { bicubic, bilinear, box, lanczos, resample };
