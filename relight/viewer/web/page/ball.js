// A matte ball under a light.

import { basis, COSINE } from "./sh.js";

// Per pixel of a ball `size` pixels wide: its irradiance is the product of nine factors with the light's coefficients.
const ballFactors = {};
function factorsOfBall(size) {
  if (ballFactors[size]) return ballFactors[size];
  const factors = new Float32Array(9 * size * size), alpha = new Float32Array(size * size);
  for (let i = 0, p = 0; i < size; i++) {
    for (let j = 0; j < size; j++, p++) {
      const x = (2 * j + 1) / size - 1, y = 1 - (2 * i + 1) / size, radius = Math.hypot(x, y);
      const inside = Math.min(1, 0.9999 / radius);
      alpha[p] = Math.min(Math.max(((1 - radius) * size) / 2 + 0.5, 0), 1);
      const normal = [x * inside, y * inside, Math.sqrt(Math.max(1 - (radius * inside) ** 2, 0))];
      basis(normal).forEach((value, k) => (factors[9 * p + k] = COSINE[k] * value));
    }
  }
  return (ballFactors[size] = { factors, alpha });
}

// A matte ball of albedo .6 under the light, on a square canvas.
export function drawBall(canvas, light, exposure = 1) {
  const size = canvas.width, context = canvas.getContext("2d"), image = context.createImageData(size, size);
  const { factors, alpha } = factorsOfBall(size);
  for (let p = 0; p < size * size; p++) {
    if (!alpha[p]) continue;
    for (let c = 0; c < 3; c++) {
      let sum = 0;
      for (let k = 0; k < 9; k++) sum += factors[9 * p + k] * light[3 * k + c];
      image.data[4 * p + c] = DEVELOPED[Math.min(Math.max(sum * exposure * 0.6 * 512, 0), 2047) | 0];
    }
    image.data[4 * p + 3] = 255 * alpha[p];
  }
  context.putImageData(image, 0, 0);
}

const DEVELOPED = Uint8ClampedArray.from({ length: 2048 }, (_, i) => {
  const light = (i + 0.5) / 512, above = Math.max(light - 0.8, 0) / 0.2; // as in relight/photos/tone.py
  const linear = Math.min(light, 0.8) + (0.2 * above) / (1 + above);
  return 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * linear ** (1 / 2.4) - 0.055);
});
