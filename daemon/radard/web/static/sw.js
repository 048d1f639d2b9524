// The service worker: keeps the shell, nothing else, so that the page opens while radard is away.
// What the radar says, pictures, events and tokens never get here.

const CACHE = "radard-shell";
const ROOT = new URL("./", self.location).pathname;
const SHELL = new Set([
  "",
  "static/app.css",
  "static/app.js",
  "static/command.js",
  "static/icon.svg",
  "static/net.js",
  "static/notify.js",
  "static/state.js",
  "static/ui.js",
  "static/charts/chart.js",
  "static/charts/colour.js",
  "static/charts/heatmap.js",
  "static/charts/pictures.js",
  "static/charts/plot.js",
  "static/charts/plots.js",
  "static/pages/clip.js",
  "static/pages/events.js",
  "static/pages/live.js",
  "static/pages/news.js",
  "static/pages/settings.js",
  "static/pages/setup.js",
  "static/pages/walk.js",
  "static/pages/why.js",
  "static/pages/zones.js",
].map((path) => ROOT + path));

self.addEventListener("install", (event) => {
  self.skipWaiting();
  // One that cannot be had now is kept when it is first asked for.
  event.waitUntil(caches.open(CACHE).then((cache) => Promise.allSettled([...SHELL].map((path) => cache.add(path)))));
});

self.addEventListener("activate", (event) => event.waitUntil(self.clients.claim()));

self.addEventListener("fetch", (event) => {
  const { method, url } = event.request;
  const { origin, pathname: asked } = new URL(url);
  // Pages of one of several sensors have the same files, below its path.
  const pathname = asked.replace(/sensor\/[\w-]+\/static\//, "static/");
  if (method !== "GET" || origin !== self.location.origin || !SHELL.has(pathname)) return;
  event.respondWith(newest(event.request, pathname));
});

// From the daemon while it answers, so that a new version holds at once.
async function newest(request, path) {
  const cache = await caches.open(CACHE);
  try {
    const answer = await fetch(request);
    if (answer.ok && !answer.redirected) await cache.put(path, answer.clone());
    return answer;
  } catch (error) {
    const kept = await cache.match(path);
    if (kept) return kept;
    throw error;
  }
}

self.addEventListener("notificationclick", (event) => {
  event.notification.close();
  const { url } = event.notification.data;
  event.waitUntil(
    self.clients.matchAll({ type: "window" }).then(async ([page]) => {
      if (!page) return self.clients.openWindow(url);
      await page.navigate(url).catch(() => {});
      return page.focus();
    }),
  );
});
