// The mask brush: paints who is to be relit. What is painted shows the photo bright, the rest is dimmed.

import { Placement, listen } from "../page/placement.js";
import { download } from "../page/saving.js";
import { app, clamp, element } from "../page/state.js";

const UNDOS = 20;
const STEP = 12; // pixels of the stage by which an arrow key moves the brush
const canvas = element("brush"), tools = element("brush-tools"), stage = element("stage");
const placement = new Placement(stage);
let photo = null; // {width, height, picture}: of the canvas of the photo
let mask = null; // a canvas whose alpha is the coverage
let finish = null; // resolves the promise of `paintMask`
let cursor = null;
const undos = [], redos = []; // coverages

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
  if (!photo) return;
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
  redos.length = 0;
  undos.push(coverage());
  if (undos.length > UNDOS) undos.shift();
}

// Goes back or forward by a stroke: takes the mask from one list, and puts what was there into the other.
function step(from, to) {
  if (!from.length) return;
  to.push(coverage());
  setCoverage(from.pop());
  draw();
}

const undo = () => step(undos, redos), redo = () => step(redos, undos);

// Moves the brush by an arrow key from where it is (at first the middle of the stage), and paints if Shift is held.
function steer(dx, dy, isPainting) {
  const [left, top, perPixel] = placement.corner(1), { clientWidth, clientHeight } = stage;
  cursor ??= toImage({ x: clientWidth / 2, y: clientHeight / 2 });
  const from = { x: (cursor.x - left) / perPixel, y: (cursor.y - top) / perPixel };
  const to = { x: clamp(from.x + STEP * dx, 0, clientWidth), y: clamp(from.y + STEP * dy, 0, clientHeight) };
  cursor = toImage(to);
  if (isPainting) paint(from, to);
  else draw();
}

// Leaves without a mask; asks before it discards what was painted.
function cancel() {
  if (undos.length) element("brush-discard").showModal();
  else close(null);
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

// Lets the user paint the mask of a photo, from `start`, a byte per pixel; `why` is told. Returns the coverage, or null
// if cancelled.
function paintMask({ pixels, width, height }, start, title, why = "") {
  if (finish) throw new Error("Finish or cancel the mask that you are painting first.");
  const [picture, context] = sheet(width, height);
  context.putImageData(new ImageData(pixels, width, height), 0, 0);
  photo = { width, height, picture, title };
  [mask] = sheet(width, height);
  setCoverage(start);
  undos.length = redos.length = 0;
  cursor = null;
  element("brush-why").textContent = why;
  canvas.hidden = tools.hidden = false;
  app.isPainting = true;
  placement.fit({ width, height, photo: true });
  draw();
  canvas.focus();
  return new Promise((done) => (finish = done));
}

const KEYS = {
  x: () => tools.querySelector("[name=brush]:not(:checked)").click(),
  "[": () => element("brush-size").stepDown(), "]": () => element("brush-size").stepUp(),
  z: undo, y: redo, enter: () => element("brush-done").click(), escape: cancel,
};
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1], " ": [0, 0] };

// The keys of the photo itself: arrows move the brush, Space paints a dot, and arrows with Shift a stroke.
function onCanvasKey(event) {
  const way = !event.ctrlKey && !event.metaKey && !event.altKey && ARROWS[event.key];
  if (!way) return;
  const isPainting = event.shiftKey || event.key === " ";
  if (isPainting && !event.repeat) remember();
  steer(...way, isPainting);
  event.preventDefault();
}

function startBrush() {
  listen(canvas, placement, { onDrag: paint, onPress: remember, onChange: draw, onFit: () => {} });
  canvas.addEventListener("pointermove", (event) => {
    const frame = canvas.getBoundingClientRect();
    cursor = toImage({ x: event.clientX - frame.left, y: event.clientY - frame.top });
    if (!event.buttons) draw();
  });
  canvas.addEventListener("keydown", onCanvasKey);
  element("brush-undo").addEventListener("click", undo);
  element("brush-redo").addEventListener("click", redo);
  element("brush-save").addEventListener("click", save);
  element("brush-cancel").addEventListener("click", cancel);
  element("brush-discard").addEventListener("close", ({ target }) => target.returnValue === "discard" && close(null));
  element("brush-done").addEventListener("click", () => close(coverage()));
  new ResizeObserver(draw).observe(stage);
  document.addEventListener("keydown", (event) => {
    const act = app.isPainting && !event.altKey && !element("brush-discard").open && KEYS[event.key.toLowerCase()];
    if (!act || (event.key === "Enter" && event.target.matches("button"))) return;
    act();
    draw();
    event.preventDefault();
  });
}

export { paintMask, startBrush };
