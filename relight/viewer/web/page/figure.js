// One embedded figure -> pixel arrays that become textures. `box` is [left, top, width, height] in image pixels.

import { bytesFromBase64, decodePlanes, inflate, unpackBits } from "./codec.js";

export function decodeSRGB(v) { return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4; }

export async function loadFigure(header) {
  const bytes = bytesFromBase64(header.data), [, , width, height] = header.box, size = width * height;
  let at = 0;
  const take = (count) => inflate(bytes.subarray(at, (at += count)));
  const regionBytes = take(header.region);
  const streams = header.planes.map((plane) => take(plane.bytes));
  const region = unpackBits(await regionBytes, size);
  const planes = {}, frame = new Uint8Array(header.width * header.height).fill(1);
  for (const [i, { name, predictors }] of header.planes.entries()) {
    const soft = planes.coverage?.[0].map((v) => v % 255), box = new Uint8Array(size).fill(1);
    const where = { photo: frame, coverage: box, edge: soft }[name] ?? region;
    planes[name] = decodePlanes(await streams[i], where, name === "photo" ? header.width : width, predictors);
  }
  const steps = Object.fromEntries(header.planes.map((plane) => [plane.name, plane.steps]));
  const photo = planes.photo && colors(planes.photo), own = photo && front(photo, planes, steps, header);
  const { transport, albedo, normal, ao, coverage } = planes;
  const linear = Float32Array.from({ length: steps.albedo + 1 }, (_, i) => decodeSRGB(i / steps.albedo));
  const maps = textures({
    transport: (k, i) => transport[k][i] / steps.transport,
    albedo: (c, i) => linear[albedo[c][i]],
    ...(normal && { normal: (c, i) => normal[c][i] / steps.normal }),
    ...(ao && { ao: (i) => ao[0][i] / 255 }),
    ...(coverage && { coverage: (i) => coverage[0][i] / 255 }),
  }, region, width);
  const excess = planes.excess && bytes3(planes.excess);
  return { ...header, data: null, hasNormals: !!normal, maps, photo, front: own, excess };
}

// Four RGBA arrays: transport 0-3, transport 4-7, (transport 8, ao, octahedral normal), (linear albedo, coverage), from
// functions of channel and pixel; ao, normal and coverage may be missing.
export function textures({ transport, albedo, normal, ao, coverage }, region, width) {
  const [first, second, third, surface] = Array.from({ length: 4 }, () => new Float32Array(4 * region.length));
  for (let i = 0, k = 0; i < region.length; i++, k += 4) {
    if (!region[i]) continue;
    for (let c = 0; c < 4; c++) {
      first[k + c] = transport(c, i);
      second[k + c] = transport(4 + c, i);
    }
    third[k] = transport(8, i);
    third[k + 1] = ao ? ao(i) : Math.min(Math.max(first[k] / 0.886227, 0), 1);
    for (let c = 0; normal && c < 2; c++) third[k + 2 + c] = normal(c, i);
    for (let c = 0; c < 3; c++) surface[k + c] = albedo(c, i);
  }
  for (let i = 0; i < region.length; i++) surface[4 * i + 3] = coverage ? coverage(i) : region[i];
  carryOutwards([first, second, third, surface], region, width);
  return [first, second, third, surface];
}

// Fills two rings of pixels around the region with the mean of their neighbours (coverage stays 0), so that filtering
// between pixels does not draw a dark line along the edge.
function carryOutwards(arrays, region, width) {
  const known = region.slice(), height = region.length / width;
  for (let ring = 0; ring < 2; ring++) {
    const grown = [];
    for (let i = 0; i < region.length; i++) {
      if (known[i]) continue;
      const x = i % width, from = [];
      if (x > 0 && known[i - 1]) from.push(i - 1);
      if (x + 1 < width && known[i + 1]) from.push(i + 1);
      if (i >= width && known[i - width]) from.push(i - width);
      if (i + width < width * height && known[i + width]) from.push(i + width);
      if (!from.length) continue;
      arrays.forEach((array, a) => {
        for (let c = 0; c < (a === 3 ? 3 : 4); c++) {
          array[4 * i + c] = from.reduce((sum, j) => sum + array[4 * j + c], 0) / from.length;
        }
      });
      grown.push(i);
    }
    for (const i of grown) known[i] = 1;
  }
}

// RGBA bytes from green, red - green, blue - green.
function colors([green, red, blue]) {
  const pixels = new Uint8Array(4 * green.length);
  for (let i = 0, k = 0; i < green.length; i++, k += 4) {
    pixels[k] = red[i] + green[i];
    pixels[k + 1] = green[i];
    pixels[k + 2] = blue[i] + green[i];
    pixels[k + 3] = 255;
  }
  return pixels;
}

// RGBA bytes from three planes of bytes.
function bytes3(planes) {
  const pixels = new Uint8Array(4 * planes[0].length);
  planes.forEach((plane, c) => plane.forEach((value, i) => (pixels[4 * i + c] = value)));
  return pixels;
}

// Linear values of the figure's own color in its box: the photo's, but for soft edges, where the background's share is
// taken out.
function front(photo, planes, steps, { width, box: [left, top, boxWidth, boxHeight] }) {
  const own = new Float32Array(4 * boxWidth * boxHeight);
  const linear = Float32Array.from({ length: 256 }, (_, code) => decodeSRGB(code / 255));
  for (let y = 0, k = 0; y < boxHeight; y++) {
    for (let x = 0, from = 4 * ((top + y) * width + left); x < boxWidth; x++, k += 4, from += 4) {
      for (let c = 0; c < 3; c++) own[k + c] = linear[photo[from + c]];
    }
  }
  if (!planes.edge) return own;
  const [green, red, blue] = planes.edge, value = (v) => 2 * decodeSRGB(v / steps.edge);
  planes.coverage[0].forEach((v, i) => {
    if (v % 255) own.set([value(red[i] + green[i]), value(green[i]), value(blue[i] + green[i])], 4 * i);
  });
  return own;
}
