// The picture as a PNG or JPEG, and a turn of the light as a short movie.

import { pixels } from "./picture.js";
import { app, set, state } from "./state.js";
import { autoRotate } from "./turning.js";

const SECONDS = 6; // of a movie
const RATE = 30; // frames a second, at most
const FORMATS = ["video/mp4;codecs=avc1.640028", "video/webm;codecs=vp9", "video/webm;codecs=vp8", "video/webm"];

function nameOf(suffix) {
  return `${app.figure.title} ${app.shown[state.light].name}.${suffix}`;
}

function download(blob, name) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = name.replace(/[^\p{L}\p{N}. _-]+/gu, "_");
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function paperOf(width, height) {
  const paper = document.createElement("canvas");
  Object.assign(paper, { width, height });
  return [paper, paper.getContext("2d")];
}

// At the size of the maps or, of a photo that was inferred in the browser, at its own.
// type: png or jpeg; where the latter would be transparent, it is white.
async function savePicture(type) {
  const name = nameOf(type.replace("jpeg", "jpg")), figure = (await app.atOwnSize?.()) ?? app.figure;
  const { width, height } = figure, [paper, context] = paperOf(width, height);
  context.putImageData(new ImageData(pixels(null, figure), width, height), 0, 0);
  if (type === "jpeg") Object.assign(context, { globalCompositeOperation: "destination-over", fillStyle: "#fff" }).fillRect(0, 0, width, height);
  download(await new Promise((done) => paper.toBlob(done, `image/${type}`, 0.95)), name);
}

// Records one turn of the light; `onProgress` gets the share that is done. Frames that the machine is too slow for are
// left out, so that the movie keeps its length. Returns the blob, or null where the browser cannot record.
async function record(onProgress, seconds = SECONDS) {
  const type = window.MediaRecorder && FORMATS.find((format) => MediaRecorder.isTypeSupported(format));
  if (!type) return null;
  autoRotate(false);
  const { width, height } = app.figure, from = state.yaw;
  const [paper, context] = paperOf(width - (width % 2), height - (height % 2)); // encoders want even sides
  context.putImageData(new ImageData(pixels(), width, height), 0, 0);
  const stream = paper.captureStream(0), [track] = stream.getVideoTracks();
  const recorder = new MediaRecorder(stream, { mimeType: type, videoBitsPerSecond: 12e6 }), parts = [];
  recorder.ondataavailable = (event) => parts.push(event.data);
  const stopped = new Promise((done) => (recorder.onstop = done));
  recorder.start();
  const began = performance.now();
  for (let share = 0; share < 1; share = (performance.now() - began) / 1000 / seconds) {
    set({ yaw: from + 360 * share });
    context.putImageData(new ImageData(pixels(), width, height), 0, 0);
    (track.requestFrame ? track : stream).requestFrame(); // Firefox has it at the stream
    onProgress(share);
    await new Promise((done) => setTimeout(done, 1000 / RATE));
  }
  recorder.stop();
  await stopped;
  set({ yaw: from });
  return new Blob(parts, { type });
}

async function saveMovie(onProgress) {
  const movie = await record(onProgress);
  if (movie) download(movie, nameOf(movie.type.startsWith("video/mp4") ? "mp4" : "webm"));
  return movie !== null;
}

export { download, record, saveMovie, savePicture };
