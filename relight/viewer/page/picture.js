// The picture on the stage: the light that the state describes, and when it is drawn.

import { drawBall } from "./ball.js";
import { lampLight } from "./lamps.js";
import { Placement } from "./placement.js";
import { rotate, turn } from "./sh.js";
import { app, element, state } from "./state.js";

const canvas = element("view"), stage = element("stage"), placement = new Placement(stage);
const OPEN = 0.886227; // transport coefficient 0 of a surface that nothing occludes
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

function scene(split) {
  const { panorama } = app.shown[state.light];
  return {
    light: currentLight(), view: state.view, background: state.background, exposure: 2 ** state.stops,
    backdrop: [1, 3, 5].map((i) => parseInt(state.color.slice(i, i + 2), 16) / 255), ratio: state.mode === "ratio",
    ...(panorama && { panorama: { ...panorama, gain: panorama.gain * state.room, rotation: rotation() } }),
    ...(state.before === "none" ? {} : { before: state.before, split }),
  };
}

function draw() {
  const ratio = Math.min(window.devicePixelRatio || 1, 2.5);
  const [width, height] = [stage.clientWidth, stage.clientHeight].map((side) => Math.max(Math.round(side * ratio), 1));
  if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
  app.renderer.draw(scene(state.split * width), placement.corner(ratio), width, height);
  drawBall(element("ball"), currentLight(), 2 ** state.stops);
  app.frames++;
}

// Draws before the next frame is shown.
function redraw() {
  if (isWaiting || !app.figure) return;
  isWaiting = true;
  requestAnimationFrame(() => {
    isWaiting = false;
    draw();
  });
}

// RGBA bytes of the picture at the image's own size; `split` in image pixels, by default where the stage shows it.
function pixels(split = null) {
  const [x, , perPixel] = placement.corner(1);
  return app.renderer.pixels(scene(split ?? x + state.split * stage.clientWidth * perPixel));
}

function fit() {
  placement.fit(app.figure);
  redraw();
}

export { canvas, currentLight, fit, pixels, placement, redraw, stage };
