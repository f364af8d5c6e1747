// Real orthonormal spherical harmonics to order 2, no Condon-Shortley phase, index l*l+l+m; +x right, +y up, +z toward
// the viewer. A light is 27 numbers: 9 radiance coefficients x (R, G, B). The same mathematics as relight/sh.

const Y0 = 0.5 / Math.sqrt(Math.PI), Y1 = Math.sqrt(3 / (4 * Math.PI)), Y2 = 0.5 * Math.sqrt(15 / Math.PI);
const Y20 = 0.25 * Math.sqrt(5 / Math.PI), Y22 = Y2 / 2;
export const COSINE = [Math.PI, ...Array(3).fill((2 * Math.PI) / 3), ...Array(5).fill(Math.PI / 4)];

export function basis([x, y, z]) {
  return [Y0, Y1 * y, Y1 * z, Y1 * x, Y2 * x * y, Y2 * y * z, Y20 * (3 * z * z - 1), Y2 * x * z, Y22 * (x * x - y * y)];
}

// Yaw turns +z toward +x, then tilt turns +z toward +y (radians); rows of the 3x3 rotation.
export function turn(yaw, tilt) {
  const c = Math.cos(yaw), s = Math.sin(yaw), d = Math.cos(tilt), t = Math.sin(tilt);
  return [[c, 0, s], [-t * s, d, t * c], [-d * s, -t, d * c]];
}

// The light turned by R, exactly: band 1 is a vector, R v, and band 2 a symmetric matrix without trace, R M R^T.
export function rotate(light, R) {
  const turned = new Float64Array(27), axes = [0, 1, 2];
  for (let c = 0; c < 3; c++) {
    const L = (k) => light[3 * k + c];
    const v = [L(3), L(1), L(2)];
    const xy = (Y2 / 2) * L(4), yz = (Y2 / 2) * L(5), xz = (Y2 / 2) * L(7);
    const xx = Y22 * L(8) - Y20 * L(6), yy = -Y22 * L(8) - Y20 * L(6), zz = 2 * Y20 * L(6);
    const M = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    const w = axes.map((i) => R[i][0] * v[0] + R[i][1] * v[1] + R[i][2] * v[2]);
    const RM = axes.map((i) => axes.map((j) => R[i][0] * M[0][j] + R[i][1] * M[1][j] + R[i][2] * M[2][j]));
    const N = axes.map((i) => axes.map((j) => RM[i][0] * R[j][0] + RM[i][1] * R[j][1] + RM[i][2] * R[j][2]));
    const out = [L(0), w[1], w[2], w[0], (2 * N[0][1]) / Y2, (2 * N[1][2]) / Y2, N[2][2] / (2 * Y20)];
    out.push((2 * N[0][2]) / Y2, (N[0][0] - N[1][1]) / (2 * Y22));
    for (let k = 0; k < 9; k++) turned[3 * k + c] = out[k];
  }
  return turned;
}

const LEAST = 0.05, DIRECTIONS = 1000; // of relight/sh/window.py
const cosines = Array.from({ length: DIRECTIONS }, (_, i) => {
  const z = 1 - (2 * i + 1) / DIRECTIONS, azimuth = i * Math.PI * (3 - Math.sqrt(5)), side = Math.sqrt(1 - z * z);
  return basis([side * Math.cos(azimuth), side * Math.sin(azimuth), z]).map((value, k) => COSINE[k] * value);
});

// The light windowed until no channel's irradiance is negative: relight/sh/window.py.
export function deringed(light) {
  const depth = [0, 0, 0], mean = [0, 1, 2].map((c) => cosines[0][0] * light[c]);
  if (Math.max(...mean) <= 0) return light;
  for (const transport of cosines) {
    for (let c = 0; c < 3; c++) {
      let sum = 0;
      for (let k = 1; k < 9; k++) sum -= transport[k] * light[3 * k + c];
      if (sum > depth[c]) depth[c] = sum;
    }
  }
  const falls = (c) => depth[c] > 1e-12 * Math.max(...mean); // a channel without light does not
  const factor = Math.min(1, ...mean.map((value, c) => (falls(c) ? ((1 - LEAST) * Math.max(value, 0)) / depth[c] : 1)));
  return light.map((value, i) => (i < 3 ? value : factor * value));
}

export { Y0, Y1, Y2, Y20, Y22 };
