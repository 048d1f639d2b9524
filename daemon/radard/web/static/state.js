// What the pages know, and who wants to hear of changes.
import { Pictures } from "./charts/pictures.js";

const MAX_DECISIONS = 900;

export const bus = new EventTarget();
export const pictures = new Pictures();
export const state = {
  connection: "connecting",
  ended: "",
  role: "viewer",
  sensor: "",
  hello: {},
  // "simulated" or "replayed" where the stream is not a live one.
  mark: "",
  confirm: [1, 1],
  zones: { include: [], exclude: [], away: [] },
  hasSavedZones: false,
  settings: null,
  hasSavedSettings: false,
  outputs: [],
  sensors: {},
  state: "starting",
  reason: "",
  panel: {},
  playback: null,
  decisions: [],
  events: new Map(),
};

export function on(name, listener, signal) {
  bus.addEventListener(name, (event) => listener(event.detail), { signal });
}

export function tell(name, detail) {
  bus.dispatchEvent(new CustomEvent(name, { detail }));
}

// The ranges that the sensor sees, in metres.
export function swath() {
  const { range_offset_m = 0.6, bin_length_m = 0.00366, n_range = 768 } = state.hello;
  return { near: range_offset_m, far: range_offset_m + bin_length_m * n_range };
}

export function isOperator() {
  return state.role === "operator";
}

// Why nothing may be changed from here now; empty where it may.
export function hindrance(isForAll = false) {
  if (state.connection !== "open") return "No connection to the sensor";
  return isForAll || isOperator() ? "" : "Only an operator may do this";
}

export function limit() {
  return state.hello.pet_limit ?? 0.8;
}

export function lastDecision() {
  return state.decisions[state.decisions.length - 1];
}

export function take(message) {
  const { type } = message;
  if (type === "welcome") welcome(message);
  else if (type === "decision") takeDecision(message);
  else if (type === "event") takeEvent(message);
  else if (type === "status") {
    state.mark = markOf(message) || state.mark;
    takeNow({ state: message.state, reason: message.reason });
  }
  else if (type === "now") takeNow(message);
  else if (type === "axes") pictures.setAxes(message);
  else if (type === "hello") {
    state.hello = message;
    state.mark = markOf(message);
    tell("hello");
  }
}

export function markOf(record) {
  return record.simulated ? "simulated" : record.replayed ? "replayed" : "";
}

function welcome(message) {
  for (const key of ["role", "sensor", "hello", "confirm", "latch_s", "sensors"]) state[key] = message[key];
  state.mark = markOf(state.hello);
  state.hasSavedZones = message.has_saved_zones;
  state.hasSavedSettings = message.has_saved_settings;
  state.outputs = message.outputs;
  state.decisions = message.decisions;
  state.events = new Map(message.events.map((event) => [event.id, event]));
  takeNow(message);
  tell("hello");
  tell("decision", lastDecision());
}

function takeDecision(decision) {
  const last = lastDecision();
  // A replay that was moved back, or a new run: what came later is no longer so.
  if (last && (decision.seq <= last.seq || decision.t_s <= last.t_s)) state.decisions = [];
  state.decisions.push(decision);
  if (state.decisions.length > MAX_DECISIONS) state.decisions.shift();
  tell("decision", decision);
}

function takeEvent(event) {
  const known = state.events.get(event.id);
  const began = known?.began ?? event.time;
  const cause = known?.cause ?? event.reason;
  state.events.set(event.id, { ...event, began, cause, clip: event.clip ?? known?.clip ?? null });
  if (event.kind === "alarm" && !event.test) {
    // The panel's own word follows; the alarm must not wait for it.
    const panel = { ...state.panel };
    if (event.phase === "end") {
      panel.alarm_id = null;
      if (panel.panel === "alarm") panel.panel = "armed";
    } else {
      panel.alarm_id = event.id;
      panel.panel = "alarm";
      panel.open = { ...panel.open, alarm: event.reason };
    }
    state.panel = panel;
  }
  tell("event", event);
  tell("now");
}

function takeNow(message) {
  for (const key of ["state", "reason", "panel", "playback", "settings"]) {
    if (message[key] !== undefined) state[key] = message[key];
  }
  if (message.zones && JSON.stringify(message.zones) !== JSON.stringify(state.zones)) {
    state.zones = message.zones;
    tell("zones");
  }
  tell("now");
}
