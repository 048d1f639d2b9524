// Notifications of this browser, while a page is open, and the service worker of the shell.
import { at, below } from "./net.js";
import { bus, markOf, state } from "./state.js";
import { inWords } from "./ui.js";

const KEPT = "radard-notify";
const TITLES = { alarm: "Alarm", tamper: "Tampering", fault: "Fault" };

// What the browser allows: "granted", "denied", "default" (not asked yet), "" where it cannot.
export function permission() {
  return "Notification" in window && window.isSecureContext ? Notification.permission : "";
}

export function wantsNews() {
  return permission() === "granted" && localStorage.getItem(KEPT) === "yes";
}

// Asks the person where that is needed; returns whether news will be shown.
export async function setNews(isWanted) {
  if (isWanted && permission() === "default") await Notification.requestPermission();
  localStorage.setItem(KEPT, isWanted ? "yes" : "");
  return wantsNews();
}

export function watchForNews() {
  // Without one, a browser neither installs the page nor lets a phone show notifications.
  navigator.serviceWorker?.register(below("/sw.js")).catch(() => {});
  bus.addEventListener("event", ({ detail }) => {
    if (detail.phase === "new" && wantsNews()) show(detail);
  });
}

async function show(event) {
  const unreal = event.test ? "Test: " : markOf(event) ? `${markOf(event)}: ` : "";
  const title = `${unreal}${TITLES[event.kind] ?? event.kind}, ${state.sensor}`;
  const options = {
    body: inWords(event.reason),
    tag: event.id,
    icon: at("/static/icon-192.png"),
    data: { url: `${location.pathname}#/events/${event.id}` },
    requireInteraction: event.kind === "alarm",
  };
  const registration = await navigator.serviceWorker?.getRegistration();
  if (registration?.active) await registration.showNotification(title, options);
  else new Notification(title, options);
}
