// Pointers on the stage: one finger or the mouse drags, two fingers or the wheel zoom and move.

export class Placement {
  // x, y: image point at the stage's centre; scale: stage pixels (CSS) per image pixel.
  constructor(stage) {
    this.stage = stage;
  }

  // The whole photo, or the figure with some air around it; on a narrow stage below the title.
  fit(figure) {
    const [left, top, width, height] = figure.photo ? [0, 0, figure.width, figure.height] : figure.box;
    const { clientWidth, clientHeight } = this.stage, title = clientWidth < 600 ? 84 : 0, air = figure.photo ? 1 : 1.14;
    this.scale = this.fitted = Math.min(clientWidth / (width * air), (clientHeight - title) / (height * air)) || 1;
    this.x = left + width / 2;
    this.y = top + height / 2 - title / 2 / this.scale;
  }

  zoom(factor, stageX, stageY) {
    const { clientWidth, clientHeight } = this.stage, before = this.scale;
    this.scale = Math.min(Math.max(before * factor, this.fitted / 2), Math.max(this.fitted, 1) * 16);
    const shift = 1 / before - 1 / this.scale;
    this.x += (stageX - clientWidth / 2) * shift;
    this.y += (stageY - clientHeight / 2) * shift;
  }

  move(dx, dy) {
    this.x -= dx / this.scale;
    this.y -= dy / this.scale;
  }

  // For the shader: image coordinates of the stage's corner, and image pixels per device pixel.
  corner(ratio) {
    const { clientWidth, clientHeight } = this.stage;
    return [this.x - clientWidth / 2 / this.scale, this.y - clientHeight / 2 / this.scale, 1 / (this.scale * ratio)];
  }
}

// onDrag gets the points on the stage from which and to which one pointer moved.
export function listen(canvas, placement, { onDrag, onChange, onFit, onPress = () => {} }) {
  const pointers = new Map();
  const middle = () => {
    const all = [...pointers.values()], n = all.length;
    const x = all.reduce((sum, p) => sum + p.x, 0) / n, y = all.reduce((sum, p) => sum + p.y, 0) / n;
    return { x, y, spread: all.reduce((sum, p) => sum + Math.hypot(p.x - x, p.y - y), 0) / n };
  };
  const where = (event) => {
    const frame = canvas.getBoundingClientRect();
    return { x: event.clientX - frame.left, y: event.clientY - frame.top };
  };
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, where(event));
    if (pointers.size === 1) onPress();
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!pointers.has(event.pointerId)) return;
    const before = middle();
    pointers.set(event.pointerId, where(event));
    const after = middle(), dx = after.x - before.x, dy = after.y - before.y;
    if (pointers.size > 1) {
      if (before.spread > 0) placement.zoom(after.spread / before.spread, after.x, after.y);
      placement.move(dx, dy);
      onChange();
    } else if (event.shiftKey || event.buttons & 6) {
      placement.move(dx, dy);
      onChange();
    } else {
      onDrag(before, after);
    }
  });
  const release = (event) => pointers.delete(event.pointerId);
  for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, release);
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("dblclick", onFit);
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    const { x, y } = where(event), pixels = event.deltaMode ? event.deltaY * 16 : event.deltaY;
    placement.zoom(Math.exp(-pixels * 0.0018), x, y);
    onChange();
  }, { passive: false });
}
