// The light turns by itself: until it is stopped, or once around when the page opens.

import { app, set, state } from "./state.js";

const SPEED = 24; // degrees a second
const OPENING = 9; // seconds that the opening turn takes

function autoRotate(start) {
  stopOpening();
  set({ auto: start });
  let last = performance.now();
  const step = (now) => {
    if (!state.auto) return;
    set({ yaw: state.yaw + Math.min((now - last) / 1000, 0.5) * SPEED });
    last = now;
    requestAnimationFrame(step);
  };
  if (start) requestAnimationFrame(step);
}

// One slow turn that eases in and out, unless the user prefers reduced motion.
function openingTurn() {
  if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
  const from = state.yaw;
  let began = null;
  app.isOpening = true;
  const step = (now) => {
    if (!app.isOpening) return;
    began ??= now;
    const share = Math.min((now - began) / 1000 / OPENING, 1);
    set({ yaw: from + 360 * share * share * (3 - 2 * share) });
    if (share < 1) requestAnimationFrame(step);
    else app.isOpening = false;
  };
  requestAnimationFrame(step);
}

function stopOpening() {
  app.isOpening = false;
}

export { autoRotate, openingTurn, stopOpening };
