// Keys, buttons and sliders, and the page's start.

async function save() {
  const { width, height } = figure, paper = document.createElement("canvas");
  Object.assign(paper, { width, height });
  const [x, , perPixel] = placement.corner(1);
  const pixels = renderer.pixels(scene(x + state.split * stage.clientWidth * perPixel));
  paper.getContext("2d").putImageData(new ImageData(pixels, width, height), 0, 0);
  const blob = await new Promise((done) => paper.toBlob(done, "image/png"));
  const link = document.createElement("a");
  link.href = URL.createObjectURL(blob);
  link.download = `${figure.title} ${shownLights[state.light].name}.png`.replace(/[^\p{L}\p{N}. _-]+/gu, "_");
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

function autoRotate(start) {
  set({ auto: start });
  let last = performance.now();
  const step = (now) => {
    if (!state.auto) return;
    set({ yaw: state.yaw + Math.min((now - last) / 1000, 0.5) * 24 });
    last = now;
    requestAnimationFrame(step);
  };
  if (start) requestAnimationFrame(step);
}

function next(list, current, by = 1) {
  return list[(list.indexOf(current) + by + list.length) % list.length];
}

const values = (name) => [...document.querySelectorAll(`input[name=${name}]`)].map((input) => input.value);
const KEYS = {
  ArrowLeft: () => turnBy(-5, 0), ArrowRight: () => turnBy(5, 0),
  ArrowUp: () => turnBy(0, 5), ArrowDown: () => turnBy(0, -5),
  " ": () => autoRotate(!state.auto),
  "[": () => set({ light: (state.light + shownLights.length - 1) % shownLights.length }),
  "]": () => set({ light: (state.light + 1) % shownLights.length }),
  "+": () => set({ stops: state.stops + 0.25 }), "=": () => KEYS["+"](), "-": () => set({ stops: state.stops - 0.25 }),
  c: () => set({ before: state.before === "none" ? element("before").options[1].value : "none" }),
  b: () => set({ background: next(values("background"), state.background) }),
  r: () => set({ yaw: 0, tilt: 0, stops: 0 }),
  0: () => refit(),
  s: save, f: fullScreen, "?": () => element("keys").showModal(),
};

function fullScreen() {
  if (document.fullscreenElement) document.exitFullscreen();
  else if (stage.requestFullscreen) stage.requestFullscreen();
  else document.body.classList.toggle("plain"); // iPhone: no full screen for a page, so the controls go
}

function refit() {
  placement.fit(figure);
  redraw();
}

document.addEventListener("keydown", (event) => {
  if (!figure || event.ctrlKey || event.metaKey || event.altKey || element("keys").open) return;
  if (event.target.matches("select")) return;
  if (event.target.matches("input, [role=slider]") && /^Arrow|^ $/.test(event.key)) return;
  if (event.target.matches("button") && event.key === " ") return;
  const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
  const view = values("view")[Number(key) - 1];
  if (view) set({ view });
  else if (KEYS[key]) KEYS[key]();
  else return;
  event.preventDefault();
});

element("yaw").addEventListener("input", (event) => {
  set({ yaw: Math.min(Number(event.target.value), 179.999), auto: false }); // 180 would jump to -180 under the thumb
});
element("tilt").addEventListener("input", (event) => set({ tilt: Number(event.target.value) }));
element("exposure").addEventListener("input", (event) => set({ stops: Number(event.target.value) }));
element("color").addEventListener("input", (event) => set({ color: event.target.value }));
element("before").addEventListener("change", (event) => set({ before: event.target.value }));
element("figure").addEventListener("change", (event) => choose(Number(event.target.value)));
element("auto").addEventListener("click", () => autoRotate(!state.auto));
element("reset").addEventListener("click", KEYS.r);
element("save").addEventListener("click", save);
element("full").addEventListener("click", fullScreen);
element("help").addEventListener("click", KEYS["?"]);

const split = element("split");
split.addEventListener("pointerdown", (event) => split.setPointerCapture(event.pointerId));
split.addEventListener("pointermove", (event) => {
  if (!split.hasPointerCapture(event.pointerId)) return;
  set({ split: (event.clientX - stage.getBoundingClientRect().left) / stage.clientWidth });
});
split.addEventListener("keydown", (event) => {
  const by = { ArrowLeft: -0.02, ArrowRight: 0.02, Home: -1, End: 1 }[event.key];
  if (!by) return;
  set({ split: state.split + by });
  event.preventDefault();
});

for (const name of ["dragenter", "dragover"]) {
  document.addEventListener(name, (event) => {
    event.preventDefault();
    element("drop").hidden = false;
  });
}
document.addEventListener("dragleave", (event) => (element("drop").hidden = event.relatedTarget === null));
document.addEventListener("drop", (event) => {
  event.preventDefault();
  element("drop").hidden = true;
  if (event.dataTransfer.files.length) openPanorama(event.dataTransfer.files[0]);
});

async function start() {
  if (!window.DecompressionStream) {
    throw new Error("This browser is too old to unpack the page: Chrome 80, Safari 16.4 or Firefox 113 would do.");
  }
  renderer = new Renderer(canvas, element("fragment").textContent.trim());
  canvas.addEventListener("redraw", redraw);
  listen(canvas, placement, {
    onTurn: (yaw, tilt) => turnBy(yaw, tilt),
    onChange: redraw,
    onFit: refit,
  });
  figures.forEach((script, i) => element("figure").append(new Option(script.dataset.title, i)));
  element("figures").hidden = figures.length < 2;
  choices(element("mode-list"), "mode", ["ratio", "full"], MODES);
  await choose(0);
  let isFitted = true;
  new ResizeObserver(() => {
    isFitted = placement.scale === placement.fitted;
    if (isFitted) placement.fit(figure);
    redraw();
  }).observe(stage);
}

// For tests, and for a page that embeds this one.
window.relight = {
  state, set, choose, placement, readHDR, project, rotate, turn, inflate, decodePlanes, openPanorama, redraw, refit,
  pixels: () => renderer.pixels(scene(state.split * figure.width)),
  lights: () => shownLights,
  figure: () => figure,
  frames: () => frames,
  ready: start().catch((error) => {
    element("loading").hidden = true;
    complain(error.message);
    throw error;
  }),
};
