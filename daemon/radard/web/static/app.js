// The frame around every page: routes, health, arming, banner, replay controls, theme.
import { themeChanged } from "./charts/chart.js";
import { isDarkNow } from "./charts/colour.js";
import { command } from "./command.js";
import { eventsPage } from "./pages/events.js";
import { livePage } from "./pages/live.js";
import { below, connect, post, watchPictures } from "./net.js";
import { watchForNews } from "./notify.js";
import { setupPage } from "./pages/setup.js";
import { hindrance, isOperator, lastDecision, on, state } from "./state.js";
import { clock, duration, h, inWords, minutes, qualified, replace, setText, toast, verdict } from "./ui.js";
import { whyPage } from "./pages/why.js";

const PAGES = { live: livePage, why: whyPage, events: eventsPage, setup: setupPage };
const TITLES = { live: "Live", why: "Why", events: "Events", setup: "Set up" };
const byId = (id) => document.getElementById(id);

let leave = null;
let shown = "";
let shownRole = "";

function route() {
  const [name, argument] = location.hash.replace(/^#\/?/, "").split("/");
  const page = PAGES[name] ? name : "live";
  if (`${page}/${argument ?? ""}` === shown) return;
  const isOther = shown.split("/")[0] !== page;
  shown = `${page}/${argument ?? ""}`;
  leave?.abort();
  leave = new AbortController();
  for (const link of document.querySelectorAll(".tabs a")) {
    if (link.getAttribute("href") === `#/${page}`) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
  document.title = `${TITLES[page]} · radard`;
  const main = byId("page");
  main.className = page;
  const { wantsPictures, nodes } = PAGES[page](argument, leave.signal);
  // The banner stays: what is new stands beneath it.
  while (main.children.length > 1) main.lastElementChild.remove();
  main.append(...nodes);
  watchPictures(wantsPictures && !document.hidden);
  document.body.dataset.pictures = wantsPictures ? "yes" : "";
  if (isOther) scrollTo(0, 0);
}

document.addEventListener("visibilitychange", () => {
  watchPictures(!document.hidden && document.body.dataset.pictures === "yes");
});

// Arming -----------------------------------------------------------------------------------

let armingKey = "";

function drawArming() {
  const { panel } = state;
  // At home differs from away only where some ranges are left out then.
  const hasHome = (state.zones.away ?? []).length > 0;
  const key = `${panel.armed} ${panel.panel} ${panel.mode} ${hasHome} ${state.role} ${state.connection}`;
  if (key === armingKey) return;
  armingKey = key;
  const isArmed = Boolean(panel.armed);
  const isHome = isArmed && panel.mode === "home";
  const title = hindrance();
  const mayNot = Boolean(title) || panel.armed === undefined;
  const button = h(
    "button",
    {
      type: "button",
      class: `arm ${isArmed ? "armed" : ""}`,
      id: "arm",
      "aria-pressed": String(isArmed),
      disabled: mayNot,
      title,
      onclick: () => command(isArmed ? "disarm" : "arm"),
    },
    h("span", { class: "switch", "aria-hidden": "true" }),
    h("span", {}, !isArmed ? "Disarmed" : panel.panel === "exit" ? "Arming" : isHome ? "Armed at home" : "Armed"),
  );
  const home = h(
    "button",
    { type: "button", class: "arm", id: "arm-home", disabled: mayNot, title, onclick: () => command("arm-home") },
    "At home",
  );
  home.setAttribute("aria-label", "Arm at home");
  const focused = document.activeElement?.id;
  replace(byId("arming"), hasHome && !isArmed ? home : null, button);
  if (focused === "arm" || focused === "arm-home") button.focus();
}

// Health -----------------------------------------------------------------------------------

const STATES = { online: "Online", degraded: "Degraded", offline: "Offline", starting: "Starting" };

function drawHealth() {
  const isLost = state.connection !== "open";
  const name = isLost ? "lost" : state.state;
  const text = isLost ? "No connection" : (STATES[state.state] ?? state.state);
  const box = byId("health");
  const key = `${name} ${state.reason}`;
  if (box.dataset.key === key) return;
  box.dataset.key = key;
  replace(
    box,
    h("span", { class: `dot ${name}`, "aria-hidden": "true" }),
    h("span", { class: "state" }, text),
  );
  box.title = state.reason || text;
}

const MARKS = {
  simulated: ["Simulated", "A simulated module: what you see does not happen anywhere"],
  replayed: ["Replayed", "A recording: what you see happened earlier"],
};

function drawSensor() {
  const others = Object.entries(state.sensors);
  const box = byId("sensor");
  const model = h("span", { class: "model" }, state.hello.model ?? (state.hello.port ? "no model" : ""));
  model.title = "The model that decides";
  byId("badge").hidden = !state.mark;
  setText(byId("badge"), MARKS[state.mark]?.[0] ?? "");
  byId("badge").title = MARKS[state.mark]?.[1] ?? "";
  if (!others.length) {
    replace(box, h("span", {}, state.sensor), model);
    return;
  }
  const choice = h(
    "select",
    {
      "aria-label": "Sensor",
      onchange: () => {
        if (choice.value) location.href = choice.value.startsWith("/") ? below(choice.value) : choice.value;
      },
    },
    h("option", { value: "" }, state.sensor),
    others.map(([name, url]) => h("option", { value: url }, name)),
  );
  replace(box, choice, model);
}

// Banner: nothing while all is well --------------------------------------------------------

function bannerOf() {
  const { panel } = state;
  document.body.classList.toggle("is-lost", state.connection === "lost" || state.state === "offline");
  if (state.connection === "lost") {
    const hasEnded = state.state === "offline" && state.reason;
    const why = hasEnded ? `radard has ended (${state.reason}).` : "What you see is old.";
    return ["lost", "Connection lost", `${why} Trying again …`, []];
  }
  if (state.connection !== "open") return null;
  if (panel.panel === "alarm" || panel.alarm_id) {
    const buttons = [
      ["Acknowledge", "ack", "primary"],
      ["Disarm", "disarm", ""],
    ];
    const title = state.mark ? `${MARKS[state.mark][0]} alarm` : "Alarm";
    return ["alarm", title, alarmText(), isOperator() ? buttons : []];
  }
  if (panel.panel === "entry") {
    const buttons = isOperator() ? [["Disarm", "disarm", "primary"]] : [];
    const text = `The alarm follows ${inSeconds(panel)} unless you disarm.`;
    return ["warn", "Somebody is in", text, buttons];
  }
  if (panel.panel === "exit") {
    const buttons = isOperator() ? [["Disarm", "disarm", ""]] : [];
    return ["calm", "Leave now", `Armed ${inSeconds(panel)}.`, buttons];
  }
  if (state.state === "offline") return ["warn", "Nobody is watching", state.reason, []];
  if (panel.open?.tamper) return ["warn", "Tampering", panel.open.tamper, []];
  if (panel.open?.fault) return ["warn", "Fault", panel.open.fault, []];
  if (state.state === "degraded" && state.playback?.is_playing !== false) {
    return ["warn", "Degraded", state.reason, []];
  }
  return null;
}

function inSeconds({ delay_left_s: left }) {
  return Number.isFinite(left) ? `in ${Math.ceil(left)} s` : "soon";
}

// What it began with and when, and when somebody was seen last.
function alarmText() {
  const event = state.events.get(state.panel.alarm_id);
  const first = inWords(event?.cause ?? state.panel.open?.alarm ?? event?.reason ?? "");
  const capital = `${first.charAt(0).toUpperCase()}${first.slice(1)}`;
  const now = state.decisions[state.decisions.length - 1];
  if (!event || !now) return capital;
  const since = `${capital}, since ${clock(event.began)} (${duration(now.t_s - event.start_t_s)})`;
  const seen = state.decisions.findLast((d) => d.alarm && d.t_s >= event.start_t_s);
  if (!seen) return `${since}.`;
  return seen === now ? `${since}. In sight now.` : `${since}. Last seen ${duration(now.t_s - seen.t_s)} ago.`;
}

function presentText() {
  return `${qualified("Now", verdict(lastDecision())[0])}. The alarm stays on until nobody was seen for ${duration(state.latch_s)}.`;
}

let bannerKey = "";

function drawBanner() {
  const wanted = bannerOf();
  const box = byId("banner");
  const key = wanted ? `${wanted[0]} ${wanted[1]} ${wanted[3].length}` : "";
  document.body.classList.toggle("in-alarm", wanted?.[0] === "alarm");
  if (key !== bannerKey) {
    bannerKey = key;
    if (!wanted) {
      replace(box);
      return;
    }
    const [tone, title, , buttons] = wanted;
    replace(
      box,
      h(
        "section",
        { class: `banner ${tone}`, role: tone === "alarm" ? "alert" : "status", "aria-label": title },
        h("strong", {}, title),
        h("span", { class: "text", "aria-live": "off" }),
        // In place of the live page's verdict, which an alarm hides.
        tone === "alarm" ? h("span", { class: "present plain", "aria-live": "off" }) : null,
        h(
          "span",
          { class: "buttons" },
          buttons.map(([text, name, kind]) =>
            h("button", { type: "button", class: kind, onclick: () => command(name) }, text),
          ),
        ),
      ),
    );
  }
  if (!wanted) return;
  setText(box.querySelector(".text"), wanted[2]);
  const present = box.querySelector(".present");
  if (present) setText(present, presentText());
}

// Replay controls --------------------------------------------------------------------------

const SPEEDS = [
  ["0.25", "¼ ×"],
  ["0.5", "½ ×"],
  ["1", "1 ×"],
  ["2", "2 ×"],
  ["4", "4 ×"],
  ["8", "8 ×"],
  ["", "as fast as possible"],
];
let player = null;

async function playback(action, value) {
  try {
    state.playback = await post("/api/v1/playback", { action, value });
    drawPlayer();
  } catch (error) {
    toast(`Not done: ${error.message}`, "bad");
  }
}

function makePlayer() {
  const play = h("button", {
    type: "button",
    class: "icon",
    onclick: () => playback(state.playback.is_playing ? "pause" : "play"),
  });
  let isHeld = false;
  const slider = h("input", {
    type: "range",
    min: "0",
    step: "1",
    "aria-label": "Position in the recording",
    onpointerdown: () => {
      isHeld = true;
    },
    onchange: () => {
      isHeld = false;
      playback("seek", Math.min(Number(slider.value), Math.max(0, state.playback.length_s - 1)));
    },
  });
  const time = h("output", { class: "number" });
  const speed = h(
    "select",
    {
      "aria-label": "Speed",
      onchange: () => playback("speed", speed.value === "" ? null : Number(speed.value)),
    },
    SPEEDS.map(([value, text]) => h("option", { value }, text)),
  );
  const element = h(
    "section",
    { class: "player", "aria-label": "Replay" },
    h("span", { class: "tag" }, "Replay"),
    play,
    slider,
    time,
    speed,
  );
  return {
    element,
    draw({ position_s, length_s, is_playing, speed: now }) {
      slider.max = String(Math.floor(length_s));
      if (!isHeld) slider.value = String(position_s);
      slider.setAttribute("aria-valuetext", `${minutes(position_s)} of ${minutes(length_s)}`);
      time.textContent = `${minutes(position_s)} / ${minutes(length_s)}`;
      for (const control of [play, slider, speed]) control.disabled = Boolean(hindrance());
      play.textContent = is_playing ? "❚❚" : "►";
      play.setAttribute("aria-label", is_playing ? "Pause" : "Play");
      speed.value = now === null ? "" : String(now);
    },
  };
}

function drawPlayer() {
  const box = byId("player");
  if (!state.playback) {
    if (player) replace(box);
    player = null;
    return;
  }
  if (!player) {
    player = makePlayer();
    replace(box, player.element);
  }
  player.draw(state.playback);
}

// Theme ------------------------------------------------------------------------------------

function setTheme(name) {
  if (name) document.documentElement.dataset.theme = name;
  else delete document.documentElement.dataset.theme;
  themeChanged();
  const button = byId("theme");
  const isDark = isDarkNow();
  button.setAttribute("aria-label", isDark ? "Use light colours" : "Use dark colours");
  button.title = button.getAttribute("aria-label");
  button.textContent = isDark ? "☀" : "☾";
}

byId("theme").addEventListener("click", () => {
  const name = isDarkNow() ? "light" : "dark";
  localStorage.setItem("radard-theme", name);
  setTheme(name);
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () =>
  setTheme(localStorage.getItem("radard-theme")),
);
setTheme(localStorage.getItem("radard-theme"));

// Details ----------------------------------------------------------------------------------

function setDetails(isOn) {
  if (isOn) document.documentElement.dataset.details = "";
  else delete document.documentElement.dataset.details;
  byId("details").setAttribute("aria-pressed", String(isOn));
}

byId("details").addEventListener("click", () => {
  const isOn = document.documentElement.dataset.details === undefined;
  localStorage.setItem("radard-details", isOn ? "yes" : "");
  setDetails(isOn);
});
setDetails(Boolean(localStorage.getItem("radard-details")));

on("now", () => {
  drawHealth();
  drawArming();
  drawBanner();
  drawPlayer();
});
on("decision", drawBanner);
on("hello", () => {
  drawSensor();
  // Pages are built for a role, so the first waits for the first word of the daemon.
  if (state.role !== shownRole) shown = "";
  shownRole = state.role;
  route();
});
addEventListener("hashchange", () => {
  if (shownRole) route();
});
on("zones", drawArming);
drawHealth();
drawArming();
watchForNews();
connect();
// While the line is made: the first time of day takes as long as all the rest of the page.
setTimeout(() => clock(new Date().toISOString()));
