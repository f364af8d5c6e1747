// Means and extremes over windows of a plane, as scipy.ndimage has them.

// Means over squares of `size` pixels, an odd number. Beyond the border is 0, or the nearest pixel if `isNearest`.
function means(plane, width, size, isNearest = false) {
  const height = plane.length / width, radius = size >> 1, sums = new Float64Array(width);
  const between = new plane.constructor(plane.length), out = new plane.constructor(plane.length);
  const add = (y, sign) => {
    if ((y < 0 || y >= height) && !isNearest) return;
    for (let x = 0, i = Math.min(Math.max(y, 0), height - 1) * width; x < width; x++, i++) sums[x] += sign * plane[i];
  };
  for (let y = -radius; y <= radius; y++) add(y, 1);
  for (let y = 0; y < height; y++) {
    for (let x = 0, i = y * width; x < width; x++, i++) between[i] = sums[x] / size;
    add(y + radius + 1, 1);
    add(y - radius, -1);
  }
  for (let y = 0; y < height; y++) {
    const from = y * width, first = isNearest ? between[from] : 0, last = isNearest ? between[from + width - 1] : 0;
    let sum = radius * first;
    for (let x = 0; x <= radius; x++) sum += x < width ? between[from + x] : last;
    for (let x = 0; x < width; x++) {
      out[from + x] = sum / size;
      sum += x + radius + 1 < width ? between[from + x + radius + 1] : last;
      sum -= x - radius >= 0 ? between[from + x - radius] : first;
    }
  }
  return out;
}

// The least and the largest value over squares of `size` pixels; where `set` (optional) has none, +-Infinity.
function extremes(plane, width, size, set = null) {
  const height = plane.length / width, radius = size >> 1;
  const pass = (source, step, length, isAlong, worse, pick) => source.map((_, i) => {
    const place = isAlong ? i % width : Math.floor(i / width);
    let value = worse;
    for (let d = Math.max(-radius, -place); d <= Math.min(radius, length - 1 - place); d++) {
      value = pick(value, source[i + d * step]);
    }
    return value;
  });
  return [[Infinity, Math.min], [-Infinity, Math.max]].map(([worse, pick]) => {
    const known = set ? plane.map((value, i) => (set[i] ? value : worse)) : plane;
    return pass(pass(known, 1, width, true, worse, pick), width, height, false, worse, pick);
  });
}

export { extremes, means };
