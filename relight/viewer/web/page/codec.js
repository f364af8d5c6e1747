// Figures back from bytes: the inverse of codec.py and figure.py.

export async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

export function bytesFromBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text), bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

// Guess of a pixel from its left, upper and upper-left neighbours: mean, median of JPEG-LS, damped gradient.
const PREDICTORS = [
  (left, up) => (left + up) >> 1,
  (left, up, corner) => {
    const low = left < up ? left : up, high = left < up ? up : left;
    return corner >= high ? low : corner <= low ? high : left + up - corner;
  },
  (left, up, corner) => (3 * (left + up) - 2 * corner) >> 2,
];

// Planes (one Int32Array of width * height each, 0 outside the region) from the residuals of encode() in codec.py.
export function decodePlanes(data, region, width, predictors) {
  const count = data.length / 2 / predictors.length;
  return predictors.map((predictor, channel) => {
    const guess = PREDICTORS[predictor], low = 2 * channel * count, high = low + count;
    const plane = new Int32Array(region.length);
    for (let i = 0, x = 0, k = 0; i < region.length; i++, x = x + 1 === width ? 0 : x + 1) {
      if (!region[i]) continue;
      const hasLeft = x > 0 && region[i - 1], hasUp = i >= width && region[i - width];
      let left = hasLeft ? plane[i - 1] : 0, up = hasUp ? plane[i - width] : 0;
      if (!hasLeft) left = up;
      if (!hasUp) up = left;
      const corner = hasLeft && hasUp && region[i - width - 1] ? plane[i - width - 1] : (left + up) >> 1;
      const folded = data[low + k] | (data[high + k] << 8);
      plane[i] = guess(left, up, corner) + ((folded >> 1) ^ -(folded & 1));
      k++;
    }
    return plane;
  });
}

export function unpackBits(bytes, count) {
  const bits = new Uint8Array(count);
  for (let i = 0; i < count; i++) bits[i] = (bytes[i >> 3] >> (7 - (i & 7))) & 1;
  return bits;
}
