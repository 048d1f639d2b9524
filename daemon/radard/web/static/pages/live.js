// Live: what the radar sees, and what it makes of it.
import { GaitMap, HeatMap, TITLES, drawScale } from "../charts/heatmap.js";
import { currentMap } from "../charts/colour.js";
import { chancesPlot, powerPlot } from "../charts/plots.js";
import { themeVersion } from "../charts/chart.js";
import { lastDecision, limit, on, pictures, state } from "../state.js";
import { card, clock, duration, fixed, h, hasDetails, percent, qualified, replace, setText, timesText, verdict, words } from "../ui.js";

const SPAN_S = 30;
const SLOW_MS = 500;
const FAST_MS = 80;
const FRAME_MS = 17;
// Of the time, at most so much is for drawing; a slow machine gets fewer pictures a second.
const MAX_SHARE = 0.25;
const LIGHT_MPS = 299792458;
const CAPTIONS = {
  range: () => [
    ...words("Strong: something moves at that distance.", "Power after clutter removal, by range."),
    h("span", { class: "dots" }, h("span", { class: "swatch human" }), "a body", h("span", { class: "swatch pet" }), "taken for a pet"),
  ],
  velocity: velocityCaption,
  doppler: () =>
    words(
      "How arms and legs swing about the speed of the body. Coming closer is up.",
      "Micro-Doppler spectrogram µ, as the networks see it; approaching is positive.",
    ),
  gait: () =>
    words(
      "How often limbs swing in a second: steady steps are a strong spot away from the left edge.",
      "Cadence velocity diagram of the last 2 s.",
    ),
};

// What the eye sees in "How fast": one movement as one band, or as several where neither the band
// nor its way through the ranges tells its speed from others.
function velocityCaption(axes) {
  const { frame_rate_hz: rate_hz, carrier_hz } = state.hello;
  // As the pictures have it once they come: c fp / (2 f).
  const apart = axes?.unambiguous_mps ?? (LIGHT_MPS * rate_hz) / (2 * carrier_hz);
  const highest = axes ? -pictures.by.get("velocity").first : Infinity;
  if (!apart || apart / 2 >= highest) return words("Coming closer is up.", "Radial velocity; approaching is positive.");
  const rate = fixed(rate_hz, 0);
  return words(
    `Coming closer is up. One body is one band; pale bands ${fixed(apart, 1)} m/s apart are its doubles, where its way does not tell which is right.`,
    `Radial velocity. At ${rate} Hz it is unambiguous within ±${fixed(apart / 2, 2)} m/s (dashed); beyond, aliases ${fixed(apart, 2)} m/s apart fade as far as range over time speaks against them.`,
  );
}

function pictureHead(name) {
  const scale = h("canvas", { class: "scale", "aria-hidden": "true" });
  const [title, subtitle] = TITLES[name];
  const head = h(
    "h3",
    {},
    `${title} `,
    h("small", { class: "exact" }, subtitle),
    h(
      "span",
      { class: "key", "aria-hidden": "true" },
      h("span", { class: "plain" }, "weak"),
      h("span", { class: "exact depth" }),
      scale,
      words("strong", "0 dB"),
    ),
  );
  return { head, scale, caption: h("p", { class: "caption" }, CAPTIONS[name](null)) };
}

export function livePage(_argument, signal) {
  const hero = makeHero();
  const list = makeList();
  const columns = h("div", { class: "columns" });
  on("decision", (decision) => {
    hero.draw(decision);
    list.draw();
  }, signal);
  on("now", () => hero.draw(lastDecision()), signal);
  hero.draw(lastDecision());
  list.draw();
  // The answer first: charts come a frame later.
  nextFrame(() => {
    if (!signal.aborted) fillColumns(columns, signal);
  });
  return {
    wantsPictures: true,
    nodes: [
      h("h1", { class: "hidden" }, "Live"),
      hero.element,
      // On a wide page the style puts it last; on a phone it comes before six charts.
      list.element,
      columns,
    ],
  };
}

// Once what was made before is on the screen.
const nextFrame = (then) => requestAnimationFrame(() => setTimeout(then));

function fillColumns(columns, signal) {
  const seen = card("What the radar sees", `last ${SPAN_S} s`);
  const made = card("What it makes of it", "a decision every second");
  const scales = new Map();
  const place = (box, name) => {
    const { head, scale, caption } = pictureHead(name);
    scales.set(name, { scale, caption });
    box.append(head, caption);
  };
  const maps = ["range", "velocity", "doppler"].map((name) => {
    place(seen, name);
    const height = name === "doppler" ? 118 : 158;
    return new HeatMap(seen, name, pictures, { height });
  });
  made.append(
    h("h3", {}, "Person or pet ", legend()),
    h(
      "p",
      { class: "caption" },
      words("How sure it is, with all it has seen of this visit. Dotted: from the last window alone.", "Fused probabilities; dotted: this window alone."),
    ),
  );
  const chances = chancesPlot(made, { label: "Person or pet over time", height: 178, hasWindows: true });
  made.append(
    h("h3", {}, "Motion"),
    h(
      "p",
      { class: "caption" },
      words("How strong the movement is. Over the dashed line it counts; the faint line is the room's own noise.", "Residual power after clutter removal; dashed: the gate's threshold, faint: the noise floor."),
    ),
  );
  const power = powerPlot(made, { label: "Motion over time", height: 138 });
  place(made, "gait");
  const gait = new GaitMap(made, pictures, { height: 118 });
  columns.append(seen, h("div", { class: "stack" }, made));
  on("decision", (decision) => describe(maps, chances, power, decision), signal);
  animate(signal, maps, [chances, power], gait, scales);
  signal.addEventListener("abort", () => [...maps, chances, power, gait].forEach((chart) => chart.close()));
}

function legend() {
  return h(
    "span",
    { class: "key" },
    h("span", { class: "swatch human" }),
    "person",
    h("span", { class: "swatch pet" }),
    "pet",
  );
}

// All charts share one edge of time, which glides instead of jumping.
function animate(signal, maps, plots, gait, scales) {
  const isCalm = matchMedia("(prefers-reduced-motion: reduce)").matches;
  let edge = null;
  let lastMs = performance.now();
  let startedMs = 0;
  let drewMs = null;
  let costMs = 0;
  let drawnTheme = -1;
  let drawnAxes = null;
  // What is left of a round: a chart a frame, since a canvas without a GPU costs most of one.
  // Colours take a while to make: before all charts, in a frame of their own.
  let left = [currentMap];
  // Nor does one come into a frame that has words of a decision to lay out, or every second one does.
  let hasWords = true;
  let hasRested = false;
  on("decision", () => (hasWords = true), signal);
  const round = (nowMs) => {
    const pauseMs = isCalm ? SLOW_MS : Math.min(2 * SLOW_MS, Math.max(FAST_MS, costMs / MAX_SHARE));
    if (nowMs - startedMs < pauseMs) return;
    const target = Math.max(pictures.end_s ?? -Infinity, (lastDecision()?.t_s ?? -Infinity) - 1);
    if (!Number.isFinite(target)) return;
    const elapsed_s = Math.min(1, (nowMs - lastMs) / 1000);
    lastMs = nowMs;
    if (edge === null || Math.abs(target - edge) > 3 || isCalm) edge = target;
    else edge += (target - edge) * (1 - Math.exp(-elapsed_s / 0.18));
    startedMs = nowMs;
    costMs = 0;
    const view = { from_s: edge - SPAN_S, to_s: edge };
    maps[0].marks = marks();
    left = [
      ...maps.filter(isInSight).map((map) => () => map.draw(view)),
      ...plots.filter(isInSight).map((plot) => () => plot.draw(view, state.decisions)),
      ...[gait].filter(isInSight).map(() => () => gait.draw(lastDecision()?.gate === "open")),
      drawScales,
    ];
  };
  const drawScales = () => {
    if (!pictures.axes || (drawnTheme === themeVersion() && drawnAxes === pictures.axes)) return;
    drawnTheme = themeVersion();
    drawnAxes = pictures.axes;
    for (const [name, { scale, caption }] of scales) {
      const { span_db } = pictures.by.get(name);
      drawScale(scale, span_db);
      replace(caption, ...CAPTIONS[name](drawnAxes));
      scale.parentElement.querySelector(".depth").textContent = `−${span_db} dB`;
    }
  };
  const step = (nowMs) => {
    if (signal.aborted) return;
    requestAnimationFrame(step);
    hasRested = hasWords && !hasRested;
    hasWords = false;
    if (hasRested) {
      drewMs = null;
      return;
    }
    const beganMs = performance.now();
    // What the browser itself does for a canvas counts as well: the next frame comes late.
    if (drewMs !== null) costMs += Math.max(0, beganMs - drewMs - FRAME_MS);
    if (!left.length) round(nowMs);
    drewMs = left.length ? beganMs : null;
    left.shift()?.();
    costMs += performance.now() - beganMs;
  };
  requestAnimationFrame(step);
}

const isInSight = (chart) => chart.isInSight;

function marks() {
  return state.decisions
    .slice(-SPAN_S - 2)
    .flatMap((d) => {
      const tone = d.label === "pet" || d.label === "other" ? "pet" : "human";
      const ranges = d.tracks.length ? d.tracks.map((t) => t.range_m) : [d.range_m];
      return ranges.filter((r) => r !== null).map((value) => ({ t_s: d.t_s, value, tone }));
    });
}

function describe(maps, chances, power, d) {
  if (!d) return;
  const where = d.range_m === null ? "nothing moves" : `strongest motion at ${fixed(d.range_m, 1)} metres`;
  maps[0].describe(`Range over time, last ${SPAN_S} seconds: ${where}`);
  const speeds = d.tracks.map((t) => fixed(t.radial_velocity_mps, 1)).join(", ");
  maps[1].describe(`Velocity over time: ${speeds ? `${speeds} metres per second` : "nothing is followed"}`);
  maps[2].describe("How arms and legs swing over time");
  const chance = d.fused_p_human === null ? "no verdict" : `person ${percent(d.fused_p_human)}, pet ${percent(d.fused_p_pet)}`;
  chances.describe(`Person or pet over time: ${chance}`);
  const exact = `${fixed(d.power_db)} decibels, threshold ${fixed(d.threshold_db)}`;
  power.describe(`Motion over time: ${hasDetails() ? exact : `${timesText(d)} the room's noise`}`);
}

function makeHero() {
  const word = h("p", { class: "word", id: "verdict" });
  const sub = h("p", { class: "quiet", id: "verdict-sub" });
  const bar = h("div", { class: "evidence", role: "img" }, h("i", { class: "human" }), h("i", { class: "pet" }), h("b", {}));
  const facts = new Map(
    [
      ["range", "Distance", "m"],
      ["speed", "Closing speed", "m/s"],
      ["times", "Over the room's noise", "", "plain"],
      ["power", "Over threshold", "dB", "exact"],
      ["bodies", "Moving bodies", ""],
      ["latency", "Latency", "ms", "exact"],
    ].map(([key, title, unit, who]) => [key, { title, unit, who, value: h("span", { class: "number" }) }]),
  );
  const element = h(
    "section",
    { class: "card hero", "aria-label": "Verdict" },
    h("div", { class: "who" }, word, sub),
    h("div", { class: "mix" }, bar, h("p", { class: "quiet mixtext" })),
    h(
      "dl",
      {},
      [...facts.values()].map(({ title, unit, who, value }) =>
        h("div", { class: who }, h("dt", {}, title), h("dd", {}, value, unit ? h("small", {}, ` ${unit}`) : null)),
      ),
    ),
  );
  const mixText = element.querySelector(".mixtext");
  const put = (key, text) => setText(facts.get(key).value, text);
  return {
    element,
    draw(d) {
      const [text, tone] = verdict(d);
      element.dataset.tone = state.panel.panel === "alarm" ? "alarm" : tone;
      const isOn = state.panel.panel === "alarm";
      const isOld = state.connection === "lost" || state.state === "offline";
      setText(word, isOld ? qualified("Last", text) : isOn ? qualified("Now", text) : text);
      setText(sub, subtitle(d));
      const hasChances = d && d.fused_p_human !== null;
      const [human, pet] = bar.children;
      human.style.width = hasChances ? `${100 * d.fused_p_human}%` : "0%";
      pet.style.width = hasChances ? `${100 * (d.fused_p_pet + d.fused_p_other)}%` : "0%";
      bar.lastChild.style.left = `${100 * (1 - limit())}%`;
      const mix = hasChances
        ? `${isOn ? "Now: person" : "Person"} ${percent(d.fused_p_human)}, pet ${percent(d.fused_p_pet)}`
        : "No evidence while nothing moves";
      setText(mixText, mix);
      bar.setAttribute("aria-label", mix);
      const nearest = d?.tracks?.[0];
      put("range", fixed(d?.range_m, 1));
      put("speed", fixed(nearest?.radial_velocity_mps, 1));
      put("times", timesText(d));
      put("power", d && d.power_db !== null ? fixed(d.power_db - d.threshold_db, 1) : "–");
      put("bodies", d ? String(Math.max(d.tracks.length, d.gate === "open" ? 1 : 0)) : "–");
      put("latency", fixed(d?.latency_ms, 0));
    },
  };
}

function subtitle(d) {
  if (state.connection === "lost") return "Last known; the connection is lost";
  if (!d) return "The first decision comes after 2.5 s";
  if (state.state === "offline") return "Last known; nobody is watching";
  if (d.gate === "invalid") return "Frames are missing or cannot be used";
  const { panel } = state.panel;
  if (panel === "alarm") {
    if (d.alarm) return "The alarm is on";
    return `The alarm stays on until nobody was seen for ${duration(state.latch_s)}, or somebody acknowledges it`;
  }
  if (panel === "entry") return "Disarm now, or the alarm follows";
  if (panel === "exit") return "Not armed yet";
  if (!state.panel.armed) return "Disarmed: nobody is told";
  if (d.alarm) return "An alarm verdict";
  return state.panel.open?.tamper ? "Armed, but tampered with" : "Armed, all is well";
}

const HEADINGS = [
  ["Time"],
  ["Verdict"],
  ["Person"],
  ["Pet"],
  ["Distance"],
  ["Over the noise", "plain"],
  ["Over threshold", "exact"],
  ["Reason", "hidden"],
];

// The last decisions, newest first; one opens the page that explains it.
function makeList() {
  const body = h("tbody", {});
  const table = h(
    "table",
    { class: "decisions" },
    h("caption", { class: "hidden" }, "Last decisions"),
    h(
      "thead",
      {},
      h("tr", {}, HEADINGS.map(([text, who]) =>
        who === "hidden"
          ? h("th", { scope: "col" }, h("span", { class: who }, text))
          : h("th", { scope: "col", class: who }, text),
      )),
    ),
    body,
  );
  const element = card("Decisions", "choose one to see why", table);
  element.classList.add("latest");
  let newest = -1;
  return {
    element,
    draw() {
      const last = state.decisions.slice(-12).reverse();
      if (last[0]?.seq === newest && body.childElementCount) return;
      // A row that is being read or pointed at must not run away.
      if (body.matches(":focus-within")) return;
      newest = last[0]?.seq ?? -1;
      replace(body, ...last.map(row));
    },
  };
}

function row(d) {
  const [text, tone] = verdict(d);
  const over = d.power_db === null ? null : d.power_db - d.threshold_db;
  return h(
    "tr",
    { class: tone, onclick: () => (location.hash = `#/why/${d.seq}`) },
    h("td", { class: "number" }, clock(d.time)),
    h("td", {}, h("span", { class: `pill ${tone}` }, text), d.alarm ? h("span", { class: "mark" }, "alarm") : null),
    h("td", { class: "number" }, percent(d.fused_p_human)),
    h("td", { class: "number" }, percent(d.fused_p_pet)),
    h("td", { class: "number" }, d.range_m === null ? "–" : `${fixed(d.range_m, 1)} m`),
    h("td", { class: "number plain" }, timesText(d)),
    h("td", { class: "number exact" }, over === null ? "–" : `${fixed(over, 1)} dB`),
    h("td", {}, h("a", { href: `#/why/${d.seq}`, "aria-label": `Why decision ${d.seq}: ${text}` }, "Why?")),
  );
}
