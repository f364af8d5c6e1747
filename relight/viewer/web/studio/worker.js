// What takes seconds, apart from the page's thread. `ort` is onnxruntime-web, imported by what starts this (studio.js).

import { linearPlanes } from "./colors.js";
import { hasOutline } from "./edges.js";
import { inferFigure } from "./infer.js";
import { lanczos, resample } from "../page/resample.js";
import { findPeople } from "./finder.js";

const sessions = {};

const tasks = {
  // mask: the network that finds people, or undefined.
  async start({ runtime, network, mask }) {
    Object.assign(ort.env.wasm, { wasmBinary: runtime, numThreads: 1 });
    const create = (bytes) => ort.InferenceSession.create(bytes, { executionProviders: ["wasm"] });
    sessions.network = await create(network);
    if (mask) sessions.mask = await create(mask);
  },

  // The photo with its longer side at most `longest` pixels, and its alpha if that may be a mask (else null).
  prepare({ photo: { pixels, width, height }, longest }) {
    const scale = Math.min(longest / Math.max(width, height), 1);
    const size = [width, height].map((side) => (scale < 1 ? Math.max(8, Math.round(side * scale)) : side));
    const stored = [0, 1, 2, 3].map((c) => Uint8Array.from({ length: width * height }, (_, i) => pixels[4 * i + c]));
    const [, , , solid] = stored, multiplied = (plane) => plane.map((v, i) => Math.round((v * solid[i]) / 255));
    const planes = scale < 1
      ? [...stored.slice(0, 3).map(multiplied), solid].map((plane) => resample(plane, width, size, lanczos)) : stored;
    const small = new Uint8ClampedArray(4 * size[0] * size[1]);
    planes[3].forEach((alpha, i) => {
      const gain = scale < 1 ? 255 / Math.max(alpha, 1) : 1;
      small.set([planes[0][i] * gain, planes[1][i] * gain, planes[2][i] * gain, alpha], 4 * i);
    });
    return { photo: { pixels: small, width: size[0], height: size[1] }, alpha: hasOutline(solid, width) ? planes[3] : null };
  },

  // The coverage of the people in the photo, or null where there is no network that finds them.
  async mask({ photo }) {
    if (!sessions.mask) return null;
    const found = await findPeople(photo, async (image) => {
      const { mask } = await sessions.mask.run({ image: new ort.Tensor("float32", image, [1, 3, 256, 256]) });
      return mask.data;
    });
    return found.map((v, i) => Math.min(v, photo.pixels[4 * i + 3]));
  },

  infer({ photo, coverage, isExact, size }) {
    return inferFigure(photo, coverage, async (planes, inside) => {
      const image = new ort.Tensor("float32", planes, [1, 3, size, size]), mask = new ort.Tensor("float32", inside, [1, 1, size, size]);
      const { albedo, transport, light } = await sessions.network.run({ image, mask });
      return { albedo: albedo.data, transport: transport.data, light: light.data };
    }, size, isExact);
  },
};

self.onmessage = async ({ data: { id, task, values } }) => {
  try {
    self.postMessage({ id, result: await tasks[task](values) });
  } catch (error) {
    self.postMessage({ id, message: error.message });
  }
};
