// The picture on the stage: the light that the state describes, and when it is drawn.

import { drawBall } from "./ball.js";
import { lampLight } from "./lamps.js";
import { hue, luminance, tintOf } from "./place.js";
import { Placement } from "./placement.js";
import { rotate, turn } from "./sh.js";
import { app, element, state } from "./state.js";

const canvas = element("view"), stage = element("stage"), placement = new Placement(stage);
const OPEN = 0.886227; // transport coefficient 0 of a surface that nothing occludes
// While the light turns, a slow machine draws fewer pixels: shares of the stage's, and the milliseconds of a frame above
// which the next share is taken. A rest of RESTED milliseconds brings all pixels back.
const SHARES = [1, 0.75, 0.55, 0.4], SLOW = 36, RESTED = 150;
let coarse = 0; // index into SHARES
let pace = 0; // a running mean of the milliseconds between frames
let resting = null;
let isWaiting = false;

function rotation() {
  return turn((state.yaw * Math.PI) / 180, (state.tilt * Math.PI) / 180);
}

// The light of the room, turned and dimmed, and of all lamps, which stay where they are.
function currentLight() {
  const room = app.shown[state.light].values;
  const light = rotate(room, rotation()).map((value) => value * state.room);
  const irradiance = OPEN * (0.2126 * room[0] + 0.7152 * room[1] + 0.0722 * room[2]);
  for (const lamp of state.lamps) lampLight(lamp, irradiance).forEach((value, i) => (light[i] += value));
  return light;
}

// The light that the photo was taken in: inferred, or one that the user knows, white on the figure as a camera has it
// (balanced in relight/photos/person.py), and in the exposure of the inferred one.
function photoLight() {
  const { light, mean } = app.figure, known = app.shown.find(({ name }) => name === state.taken);
  if (!light || !known) return light?.flat();
  const turned = rotate(known.values, turn((state.takenYaw * Math.PI) / 180, 0));
  const color = (values) => [0, 1, 2].map((c) => mean.reduce((sum, value, k) => sum + value * values[3 * k + c], 0));
  const gain = luminance(color(light.flat())) / luminance(color(turned)), white = hue(color(turned));
  return gain > 0 && gain < Infinity ? turned.map((value, i) => (value * gain) / white[i % 3]) : light.flat();
}

function scene(split) {
  const { panorama } = app.shown[state.light], { picture } = app, light = currentLight();
  return {
    light, photoLight: photoLight(), view: state.view, background: state.background, exposure: 2 ** state.stops,
    backdrop: [1, 3, 5].map((i) => parseInt(state.color.slice(i, i + 2), 16) / 255), ratio: state.mode === "ratio",
    ...(panorama && { panorama: { ...panorama, gain: panorama.gain * state.room, rotation: rotation() } }),
    ...(picture && { picture: { ...picture, tint: tintOf(picture.white, light).map((value) => value * state.room) } }),
    ...(state.before === "none" ? {} : { before: state.before, split }),
  };
}

const isTurning = () => state.auto || app.isOpening || app.isDragged;

function keepPace(milliseconds) {
  pace += (milliseconds - pace) / 3;
  if (pace < SLOW || coarse === SHARES.length - 1) return;
  coarse++;
  pace = 0;
}

function draw(began) {
  const share = isTurning() ? SHARES[coarse] : 1, ratio = share * Math.min(window.devicePixelRatio || 1, 2.5);
  clearTimeout(resting);
  if (isTurning()) {
    requestAnimationFrame((now) => keepPace(now - began));
    resting = setTimeout(rest, RESTED);
  }
  const [width, height] = [stage.clientWidth, stage.clientHeight].map((side) => Math.max(Math.round(side * ratio), 1));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  app.renderer.draw(scene(state.split * width), placement.corner(ratio), width, height);
  drawBall(element("ball"), currentLight(), 2 ** state.stops);
  app.frames++;
}

function rest() {
  if (state.auto || app.isOpening) return;
  app.isDragged = false;
  redraw();
}

// Draws before the next frame is shown.
function redraw() {
  if (isWaiting || !app.figure) return;
  isWaiting = true;
  requestAnimationFrame((now) => {
    isWaiting = false;
    draw(now);
  });
}

// RGBA bytes of the picture at the image's own size; `split` in image pixels, by default where the stage shows it.
// figure: the one that is shown, or the same with more pixels.
function pixels(split = null, figure = app.figure) {
  const [x, , perPixel] = placement.corner(1), isOther = figure !== app.figure;
  const onStage = (x + state.split * stage.clientWidth * perPixel) * (figure.width / app.figure.width);
  if (isOther) app.renderer.show(figure);
  const bytes = app.renderer.pixels(scene(split ?? onStage));
  if (isOther) app.renderer.show(app.figure);
  return bytes;
}

function fit() {
  placement.fit(app.figure);
  redraw();
}

export { canvas, currentLight, fit, pixels, placement, redraw, stage };
