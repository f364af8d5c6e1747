// The networks, in a worker of their own. First all files are loaded, then the page forbids itself every further
// request, and only then the worker starts and a photo is read.

import { element, page } from "../page/state.js";

const LOCKED = "default-src 'none'; script-src blob: 'wasm-unsafe-eval'; worker-src blob:; style-src 'unsafe-inline'; img-src data: blob:";
// A module of one function that uses SIMD, without which the networks do not run.
const SIMD = [0, 97, 115, 109, 1, 0, 0, 0, 1, 5, 1, 96, 0, 1, 123, 3, 2, 1, 0, 10, 10, 1, 8, 0, 65, 0, 253, 15, 253, 98, 11];
const WAIT = 4000; // milliseconds for the service worker, which not every server and browser allows

// The bytes of a file of the site; onProgress gets how many have come.
async function load({ name, sha256 }, onProgress) {
  const answer = await fetch(name);
  if (!answer.ok) throw new Error(`${name} did not come (${answer.status}).`);
  const parts = [], reader = answer.body.getReader();
  for (let { value } = await reader.read(); value; { value } = await reader.read()) {
    parts.push(value);
    onProgress(value.length);
  }
  const bytes = await new Blob(parts).arrayBuffer();
  if (crypto.subtle) { // which browsers have over https and on localhost
    const found = Array.from(new Uint8Array(await crypto.subtle.digest("SHA-256", bytes)), (b) => b.toString(16).padStart(2, "0")).join("");
    if (found !== sha256) throw new Error(`${name} is of another version than this page: reload the page.`);
  }
  return bytes;
}

// From now on the browser refuses all that this page and what it starts would load or send: policies only add up. They
// do not cover WebRTC (no browser knows `webrtc 'block'`), nor that a page is left for another; nothing here does either.
function lock() {
  const policy = document.createElement("meta");
  Object.assign(policy, { httpEquiv: "Content-Security-Policy", content: LOCKED });
  document.head.append(policy);
}

// Keeps the site for use without a network. Files that are loaded after it has taken over are kept, too.
async function keepSite() {
  const { serviceWorker } = navigator;
  if (!serviceWorker) return;
  const taken = new Promise((done) => serviceWorker.addEventListener("controllerchange", done, { once: true }));
  await serviceWorker.register("sw.js").catch(() => null);
  if (!serviceWorker.controller) await Promise.race([taken, new Promise((done) => setTimeout(done, WAIT))]);
}

// A function (task, values, transfer) -> promise of the worker's answer.
function startWorker(runtime) {
  const blob = (parts) => URL.createObjectURL(new Blob(parts, { type: "text/javascript" }));
  const script = `import * as ort from "${blob([runtime])}";\n${element("worker").textContent}`;
  const worker = new Worker(blob([script]), { type: "module" }), waiting = new Map();
  worker.onmessage = ({ data: { id, result, message } }) => {
    const { done, failed } = waiting.get(id);
    waiting.delete(id);
    if (message === undefined) done(result);
    else failed(new Error(message));
  };
  worker.onerror = (event) => waiting.forEach(({ failed }) => failed(new Error(event.message ?? "The worker failed.")));
  let last = 0;
  return (task, values, transfer = []) => new Promise((done, failed) => {
    waiting.set(++last, { done, failed });
    worker.postMessage({ id: last, task, values }, transfer);
  });
}

// Loads and starts all; onProgress gets the share that has come, and the bytes in all. Returns the worker's function.
async function startEngine(onProgress) {
  if (!window.WebAssembly?.validate(Uint8Array.from(SIMD))) {
    throw new Error("This browser has no WebAssembly with SIMD, by which photos are inferred: open the page in another, or a newer one.");
  }
  await keepSite();
  const { files } = page.web;
  const total = files.reduce((sum, { bytes }) => sum + bytes, 0);
  let come = 0;
  const loaded = await Promise.all(files.map((file) => load(file, (count) => onProgress((come += count) / total, total))));
  const [script, ...binaries] = loaded, [runtime, network, mask] = binaries;
  lock();
  const ask = startWorker(script);
  await ask("start", { runtime, network, mask }, binaries);
  return ask;
}

export { startEngine };
