// The site without a network: what was loaded once is kept, one version at a time.

const KIND = `relight ${registration.scope} `, CACHE = `${KIND}%version%`;

// Past the browser's own cache, which may hold files of an older version for as long as the server allowed.
const load = (request) => fetch(request, { cache: "reload" });

self.addEventListener("install", (event) => {
  event.waitUntil(Promise.all([caches.open(CACHE), load("./")]).then(([cache, answer]) => {
    if (!answer.ok) throw new Error(`The page did not come (${answer.status}).`);
    return cache.put("./", answer);
  }).then(() => self.skipWaiting()));
});

self.addEventListener("activate", (event) => {
  const old = (name) => name.startsWith(KIND) && name !== CACHE;
  event.waitUntil(caches.keys().then((names) => Promise.all(names.filter(old).map((name) => caches.delete(name))))
    .then(() => self.clients.claim()));
});

self.addEventListener("fetch", (event) => {
  event.respondWith(caches.open(CACHE).then(async (cache) => {
    const kept = await cache.match(event.request, { ignoreSearch: true });
    if (kept) return kept;
    const answer = await load(event.request);
    if (answer.ok && event.request.method === "GET") cache.put(event.request, answer.clone());
    return answer;
  }));
});
