// What there is to choose from: figures, lights, views, backgrounds; and the user's own panorama.

function choices(list, name, values, labels = LABELS) {
  list.replaceChildren(...values.map((value) => {
    const label = document.createElement("label"), input = document.createElement("input");
    Object.assign(input, { type: "radio", name, value });
    input.addEventListener("change", () => set({ [name]: value }));
    label.append(input, labels[value]);
    return label;
  }));
}

function listLights() {
  element("light-list").replaceChildren(...shownLights.map(({ name, values }, i) => {
    const label = document.createElement("label"), input = document.createElement("input");
    const ball = document.createElement("canvas"), text = document.createElement("span");
    Object.assign(input, { type: "radio", name: "light", value: i });
    Object.assign(ball, { width: 96, height: 96 });
    label.title = text.textContent = name;
    input.addEventListener("change", () => set({ light: i }));
    drawBall(ball, values);
    label.append(input, ball, text);
    return label;
  }));
  const tile = element("open-tile").content.cloneNode(true);
  tile.querySelector("input").addEventListener("change", (event) => openPanorama(event.target.files[0]));
  element("light-list").append(tile);
}

// The factor for a light that gives the figure the brightness it has under `reference`: the mean luminance of its
// shading at the turn about the vertical where it is largest (relight.photos.relight.matched).
function matched(reference, light) {
  const brightest = (values) => {
    const luminances = Array.from({ length: 72 }, (_, step) => {
      const turned = rotate(values, turn((2 * Math.PI * step) / 72, 0));
      const luminance = (k) => 0.2126 * turned[3 * k] + 0.7152 * turned[3 * k + 1] + 0.0722 * turned[3 * k + 2];
      return figure.mean.reduce((sum, value, k) => sum + value * luminance(k), 0);
    });
    return Math.max(...luminances);
  };
  const had = brightest(reference), has = brightest(light);
  return had > 1e-6 && has > 1e-6 ? had / has : 1;
}

// The lights as this figure is shown under them: those of a photo are matched to the light that it was taken in.
function collectLights() {
  shownLights = lights;
  if (figure.light) {
    const own = Float64Array.from(figure.light.flat());
    shownLights = lights.map(({ name, values }) => {
      const gain = matched(own, values);
      return { name, values: values.map((v) => v * gain) };
    });
    shownLights.unshift({ name: "As taken", values: own });
  }
  listLights();
}

async function openPanorama(file) {
  try {
    const light = project(readHDR(await file.arrayBuffer()));
    if (!light.some((v) => v)) throw new Error("The panorama is black.");
    const gain = matched(shownLights[0].values, light);
    lights.push({ name: file.name.replace(/\.[^.]+$/, ""), values: light.map((v) => v * gain) });
    collectLights();
    set({ light: shownLights.length - 1, yaw: 0, tilt: 0 });
    element("light-list").children[state.light].scrollIntoView({ block: "nearest" });
  } catch (error) {
    complain(error.message);
  }
}

function complain(message) {
  const toast = element("toast");
  toast.textContent = message;
  toast.hidden = false;
  clearTimeout(toast.timer);
  toast.timer = setTimeout(() => (toast.hidden = true), 7000);
}

async function choose(index) {
  element("loading").hidden = false;
  await new Promise(requestAnimationFrame);
  const chosen = await loadFigure(JSON.parse(figures[index].textContent));
  const isFirst = !figure;
  figure = chosen;
  renderer.show(figure);
  const ifPhoto = figure.photo ? ["photo"] : [], ifNormals = figure.hasNormals ? ["normal"] : [];
  const views = ["relit", ...ifPhoto, "albedo", "shading", "ao", ...ifNormals];
  const sides = ["none", ...ifPhoto, ...(figure.hasNormals ? ["open"] : []), "albedo", "shading"];
  choices(element("view-list"), "view", views);
  choices(element("background-list"), "background", [...ifPhoto, "studio", "light", "color", "clear"]);
  element("before").replaceChildren(...sides.map((side) => new Option(LABELS[side] ?? "nothing", side)));
  element("modes").hidden = !figure.light;
  collectLights();
  if (isFirst) set({ background: state.background ?? (figure.photo ? "photo" : "studio") });
  if (!views.includes(state.view)) set({ view: "relit" });
  if (!sides.includes(state.before)) set({ before: "none" });
  if (!figure.photo && state.background === "photo") set({ background: "studio" });
  set({ light: Math.min(state.light, shownLights.length - 1) });
  placement.fit(figure);
  element("loading").hidden = true;
  refresh();
}
