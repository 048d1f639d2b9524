// Small tools for building pages: elements, numbers, times, messages.

export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [key, value] of Object.entries(attributes)) {
    if (value === null || value === undefined || value === false) continue;
    if (key.startsWith("on")) element.addEventListener(key.slice(2), value);
    else if (key === "class") element.className = value;
    else if (value === true) element.setAttribute(key, "");
    else element.setAttribute(key, value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined));
  return element;
}

export function replace(parent, ...children) {
  parent.replaceChildren(...children.flat().filter((child) => child !== null));
}

export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// Words for a person, and those for an engineer, who asks for them by the switch "Details".
export function words(plain, exact) {
  return [h("span", { class: "plain" }, plain), h("span", { class: "exact" }, exact)];
}

export function hasDetails() {
  return document.documentElement.dataset.details !== undefined;
}

export function card(title, note, ...children) {
  return h(
    "section",
    { class: "card" },
    h("h2", {}, title, note ? h("small", {}, ...[note].flat()) : null),
    ...children,
  );
}

const WHO = {
  human: "a person",
  undecided: "something that may be a person",
  pet: "a pet that may be a person",
  other: "a thing that may be a person",
};

// The reason of an alarm, "human at 1.8 m, again", as a person would say it.
export function inWords(reason) {
  const [, label, where] = /^(\w+)(?: for [\d.]+ s)?( at [\d.]+ m)?(?:, again)?$/.exec(reason) ?? [];
  return WHO[label] ? `${WHO[label]}${where ?? ""}` : reason;
}

// How much stronger than the noise, as a factor.
export function times(d) {
  if (!d || d.power_db === null || d.noise_floor_db === null) return null;
  return 10 ** ((d.power_db - d.noise_floor_db) / 10);
}

export function timesText(d) {
  const ratio = times(d);
  if (ratio === null || !Number.isFinite(ratio)) return DASH;
  return ratio >= 1000 ? "> 1000 ×" : `${ratio.toFixed(ratio < 9.95 ? 1 : 0)} ×`;
}

const DASH = "–";
const MINUS = "−";
// Made once: to make one takes longer than to use it a hundred times.
let clockFormat;

export function fixed(value, digits = 1) {
  if (value === null || value === undefined || !Number.isFinite(value)) return DASH;
  const text = value.toFixed(digits);
  return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", MINUS);
}

export function percent(value) {
  return value === null || value === undefined ? DASH : `${Math.round(100 * value)} %`;
}

export function clock(iso) {
  if (!iso) return DASH;
  clockFormat ??= new Intl.DateTimeFormat([], { hour: "2-digit", minute: "2-digit", second: "2-digit" });
  return clockFormat.format(new Date(iso));
}

export function day(iso) {
  const date = new Date(iso);
  const today = new Date();
  if (date.toDateString() === today.toDateString()) return "Today";
  today.setDate(today.getDate() - 1);
  if (date.toDateString() === today.toDateString()) return "Yesterday";
  return date.toLocaleDateString([], { weekday: "short", day: "numeric", month: "short", year: "numeric" });
}

export function duration(seconds) {
  if (!Number.isFinite(seconds)) return DASH;
  const s = Math.max(0, Math.round(seconds));
  if (s < 60) return `${s} s`;
  if (s < 3600) return `${Math.floor(s / 60)} min ${String(s % 60).padStart(2, "0")} s`;
  return `${Math.floor(s / 3600)} h ${String(Math.floor((s % 3600) / 60)).padStart(2, "0")} min`;
}

export function minutes(seconds) {
  const s = Math.max(0, Math.floor(seconds));
  return `${Math.floor(s / 60)}:${String(s % 60).padStart(2, "0")}`;
}

export function toast(text, kind = "") {
  const element = h("div", { class: `toast ${kind}` }, text);
  document.getElementById("toasts").append(element);
  setTimeout(() => element.remove(), 5000);
}

// What a label means, in a word a person would use, and its tone.
export const VERDICTS = {
  human: ["Person", "human"],
  pet: ["Pet", "pet"],
  other: ["Harmless thing", "pet"],
  pending: ["Looking …", "pending"],
  none: ["Nothing moves", "none"],
  invalid: ["Cannot judge", "invalid"],
  moving: ["Something moves", "pending"],
};

export function verdict(decision) {
  if (!decision) return ["Waiting", "none"];
  // An undecided body counts as a person, and is not called one.
  if (decision.label === "human" && decision.fused_p_human !== null && decision.fused_p_human < 0.5) return ["Maybe a person", "human"];
  return VERDICTS[decision.label ?? "moving"] ?? VERDICTS.moving;
}

// "Now: pet" for "Pet".
export function qualified(when, word) {
  return `${when}: ${word.charAt(0).toLowerCase()}${word.slice(1).replace(" …", "")}`;
}

export function download(name, text, type) {
  const link = h("a", { href: URL.createObjectURL(new Blob([text], { type })), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

export async function copy(text) {
  try {
    await navigator.clipboard.writeText(text);
    toast("Copied");
  } catch {
    toast("The browser does not let pages copy here; select the text instead", "bad");
  }
}
