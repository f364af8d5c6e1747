// The mask brush: paints who is to be relit. What is painted shows the photo bright, the rest is dimmed.

import { Placement, listen } from "../page/placement.js";
import { download } from "../page/saving.js";
import { app, element } from "../page/state.js";

const UNDOS = 20;
const canvas = element("brush"), tools = element("brush-tools"), stage = element("stage");
const placement = new Placement(stage);
let photo = null; // {width, height, picture}: of the canvas of the photo
let mask = null; // a canvas whose alpha is the coverage
let finish = null; // resolves the promise of `paintMask`
let cursor = null;
const undos = [];

const value = (name) => tools.querySelector(`[name=${name}]:checked`)?.value;
const radius = () => Number(element("brush-size").value) / 2 / placement.scale;

function sheet(width, height) {
  const made = Object.assign(document.createElement("canvas"), { width, height });
  return [made, made.getContext("2d", { willReadFrequently: true })];
}

function coverage() {
  const { data } = mask.getContext("2d").getImageData(0, 0, photo.width, photo.height);
  return Uint8Array.from({ length: photo.width * photo.height }, (_, i) => data[4 * i + 3]);
}

function setCoverage(bytes) {
  const image = new ImageData(photo.width, photo.height);
  bytes.forEach((byte, i) => (image.data[4 * i + 3] = byte));
  mask.getContext("2d").putImageData(image, 0, 0);
}

function draw() {
  const ratio = Math.min(window.devicePixelRatio || 1, 2.5);
  const [width, height] = [stage.clientWidth, stage.clientHeight].map((side) => Math.max(Math.round(side * ratio), 1));
  Object.assign(canvas, { width, height });
  const context = canvas.getContext("2d"), [x, y, perPixel] = placement.corner(ratio);
  const [cut, cutting] = sheet(photo.width, photo.height);
  cutting.drawImage(mask, 0, 0);
  cutting.globalCompositeOperation = "source-in";
  cutting.drawImage(photo.picture, 0, 0);
  context.setTransform(1 / perPixel, 0, 0, 1 / perPixel, -x / perPixel, -y / perPixel);
  context.globalAlpha = 0.3;
  context.drawImage(photo.picture, 0, 0);
  context.globalAlpha = 1;
  context.fillStyle = "#4a78d048"; // a tint, since the background of a dark photo could not be told from black cloth
  context.fillRect(0, 0, photo.width, photo.height);
  context.drawImage(cut, 0, 0);
  if (!cursor) return;
  context.beginPath();
  context.arc(cursor.x, cursor.y, radius(), 0, 2 * Math.PI);
  for (const [color, wide] of [["#000a", 3], ["#fff", 1.5]]) {
    Object.assign(context, { strokeStyle: color, lineWidth: wide * perPixel * ratio });
    context.stroke();
  }
}

function toImage({ x, y }) {
  const [left, top, perPixel] = placement.corner(1);
  return { x: left + x * perPixel, y: top + y * perPixel };
}

function paint(from, to) {
  const context = mask.getContext("2d"), [a, b] = [from, to].map(toImage);
  Object.assign(context, { lineCap: "round", lineWidth: 2 * radius() });
  context.globalCompositeOperation = value("brush") === "person" ? "source-over" : "destination-out";
  context.beginPath();
  context.moveTo(a.x, a.y);
  context.lineTo(b.x, b.y);
  context.stroke();
  cursor = b;
  draw();
}

function remember() {
  undos.push(coverage());
  if (undos.length > UNDOS) undos.shift();
}

function undo() {
  if (!undos.length) return;
  setCoverage(undos.pop());
  draw();
}

function close(result) {
  if (!finish) return;
  canvas.hidden = tools.hidden = true;
  app.isPainting = false;
  finish(result);
  finish = photo = mask = null;
}

async function save() {
  const [paper, context] = sheet(photo.width, photo.height);
  context.fillRect(0, 0, photo.width, photo.height);
  const image = context.getImageData(0, 0, photo.width, photo.height);
  coverage().forEach((byte, i) => image.data.fill(byte, 4 * i, 4 * i + 3));
  context.putImageData(image, 0, 0);
  download(await new Promise((done) => paper.toBlob(done, "image/png")), `${photo.title}_mask.png`);
}

// Lets the user paint the mask of a photo, from `start`, a byte per pixel. Returns the coverage, or null if cancelled.
function paintMask({ pixels, width, height }, start, title) {
  const [picture, context] = sheet(width, height);
  context.putImageData(new ImageData(pixels, width, height), 0, 0);
  photo = { width, height, picture, title };
  [mask] = sheet(width, height);
  setCoverage(start);
  undos.length = 0;
  cursor = null;
  canvas.hidden = tools.hidden = false;
  app.isPainting = true;
  placement.fit({ width, height, photo: true });
  draw();
  return new Promise((done) => (finish = done));
}

const KEYS = {
  x: () => tools.querySelector("[name=brush]:not(:checked)").click(),
  "[": () => element("brush-size").stepDown(), "]": () => element("brush-size").stepUp(),
  z: undo, enter: () => element("brush-done").click(), escape: () => close(null),
};

function startBrush() {
  listen(canvas, placement, { onDrag: paint, onPress: remember, onChange: draw, onFit: () => {} });
  canvas.addEventListener("pointermove", (event) => {
    const frame = canvas.getBoundingClientRect();
    cursor = toImage({ x: event.clientX - frame.left, y: event.clientY - frame.top });
    if (!event.buttons) draw();
  });
  element("brush-undo").addEventListener("click", undo);
  element("brush-save").addEventListener("click", save);
  element("brush-cancel").addEventListener("click", () => close(null));
  element("brush-done").addEventListener("click", () => close(coverage()));
  new ResizeObserver(() => photo && draw()).observe(stage);
  document.addEventListener("keydown", (event) => {
    const act = app.isPainting && !event.altKey && KEYS[event.key.toLowerCase()];
    if (!act || (event.key === "Enter" && event.target.matches("button"))) return;
    act();
    draw();
    event.preventDefault();
  });
}

export { paintMask, startBrush };
