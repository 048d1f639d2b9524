// Why: one decision, its pictures frozen, and the stage that decided.
import { HeatMap, TITLES } from "../charts/heatmap.js";
import { get } from "../net.js";
import { chancesPlot } from "../charts/plots.js";
import { lastDecision, on, pictures, state } from "../state.js";
import { card, clock, fixed, h, replace, setText, verdict, words } from "../ui.js";

const AROUND_S = 6;
const BEHIND_S = 1.5;
const STAGES = {
  frames: ["Was everything received?", "Frames"],
  gate: ["Does something move?", "Gate"],
  classifier: ["What does it look like?", "Network"],
  evidence: ["And with the seconds before?", "Evidence"],
  rule: ["Does it count as a person?", "Rule"],
  zones: ["Is it where it counts?", "Zones"],
  confirmation: ["Has it been seen often enough?", "Confirmation"],
  panel: ["Is the alarm on?", "Panel"],
};
const MAX_TICKS = 90;

export function whyPage(argument, signal) {
  const chosen = Number(argument) || lastDecision()?.seq;
  const strip = makeStrip(chosen, signal);
  on("decision", strip.draw, signal);
  strip.draw();
  const detail = h("div", { class: "detail" });
  if (chosen) showDecision(detail, chosen, signal);
  else {
    replace(detail, h("p", { class: "quiet loading" }, "No decision yet: the first comes after 2.5 s."));
    on("decision", () => (location.hash = `#/why/${lastDecision().seq}`), signal);
  }
  return {
    // The line of pictures goes on, so that the next decision has some to show.
    wantsPictures: true,
    nodes: [h("h1", { class: "hidden" }, "Why"), strip.element, detail],
  };
}

// The last decisions as a strip of ticks, walked with the arrow keys.
function makeStrip(chosen, signal) {
  const ticks = h("div", {
    class: "ticks",
    role: "listbox",
    tabindex: "0",
    "aria-label": "Decisions; arrow keys choose",
  });
  // Wherever on the page the focus is, unless what has it needs these keys itself.
  const onKey = (event) => {
    const by = { ArrowLeft: -1, ArrowRight: 1, Home: -1e9, End: 1e9 }[event.key];
    const isTaken = event.target.closest?.("input, select, textarea");
    if (!by || isTaken || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    const known = state.decisions.map((d) => d.seq);
    const at = known.indexOf(chosen);
    const next = known[Math.min(known.length - 1, Math.max(0, (at < 0 ? known.length - 1 : at) + by))];
    location.hash = `#/why/${next}`;
  };
  addEventListener("keydown", onKey, { signal });
  const element = card("Decisions", "newest on the right; the arrow keys walk along them", ticks);
  return {
    element,
    draw() {
      let shown = state.decisions.slice(-MAX_TICKS);
      const at = state.decisions.findIndex((d) => d.seq === chosen);
      if (at >= 0 && at < state.decisions.length - MAX_TICKS) {
        const first = Math.max(0, at - MAX_TICKS / 2);
        shown = state.decisions.slice(first, first + MAX_TICKS);
      }
      replace(
        ticks,
        ...shown.map((d) => {
          const [text, tone] = verdict(d);
          return h("a", {
            href: `#/why/${d.seq}`,
            class: `tick ${tone} ${d.alarm ? "high" : ""}`,
            role: "option",
            tabindex: "-1",
            "aria-selected": String(d.seq === chosen),
            "aria-label": `${clock(d.time)} ${text}`,
            title: `${clock(d.time)} ${text}`,
          });
        }),
      );
    },
  };
}

async function showDecision(detail, seq, signal) {
  let why;
  try {
    why = await get(`/api/v1/decisions/${seq}`);
  } catch (error) {
    replace(detail, h("p", { class: "quiet loading" }, `Decision ${seq}: ${error.message}.`));
    return;
  }
  if (signal.aborted) return;
  const d = why.decision;
  const [, tone] = verdict(d);
  const head = h(
    "header",
    { class: "card whyhead", "data-tone": d.alarm ? "human" : tone },
    h("div", {}, h("p", { class: "word", id: "headline" }, why.headline), h("p", { class: "quiet" }, `Decision ${seq}, ${clock(d.time)}`, h("span", { class: "exact" }, `, ${fixed(d.t_s, 2)} s of the stream`))),
    h(
      "nav",
      { "aria-label": "Neighbours" },
      h("a", { class: "button", href: `#/why/${seq - 1}` }, "‹ Before"),
      h("a", { class: "button", href: `#/why/${seq + 1}` }, "Next ›"),
      h("a", { class: "button", href: "#/live" }, "Live"),
    ),
  );
  const told = card("How it was decided", null, stages(why));
  const frozen = card("What it was made of", words("frozen; the bright part is what it looked at", "frozen; the bright part is this decision's window"));
  replace(detail, head, h("div", { class: "columns why" }, told, frozen));
  drawFrozen(frozen, d, signal);
}

function stages(why) {
  return h(
    "ol",
    { class: "stages" },
    why.stages.map(({ name, outcome, text, plain }) =>
      h(
        "li",
        { class: outcome === "decided" && name === why.decided_by ? "decided" : "passed" },
        h("h3", {}, STAGES[name] ? words(...STAGES[name]) : name, name === why.decided_by ? h("span", { class: "mark" }, "decided here") : null),
        h("p", {}, words(plain, text)),
      ),
    ),
  );
}

function drawFrozen(box, d, signal) {
  const dwell_s = (state.hello.dwell_frames ?? 147) / (state.hello.frame_rate_hz ?? 60);
  const view = { from_s: d.t_s - AROUND_S, to_s: d.t_s + BEHIND_S };
  const status = h("p", { class: "quiet" });
  box.append(status);
  const draw = () => {
    const maps = ["range", "velocity", "doppler"].map((name) => {
      const [title, subtitle] = TITLES[name];
      box.append(h("h3", {}, `${title} `, h("small", { class: "exact" }, subtitle)));
      const height = name === "doppler" ? 112 : 142;
      const map = new HeatMap(box, name, null, { height, isRelative: false });
      map.shade = { from_s: d.t_s - dwell_s, to_s: d.t_s };
      map.describe(`${title}: frozen at decision ${d.seq}`);
      return map;
    });
    const kept = pictures.frozen(view.from_s, view.to_s);
    for (const map of maps) map.setPictures(kept);
    maps[0].marks = d.tracks.map((t) => ({ t_s: d.t_s, value: t.range_m, tone: d.alarm ? "human" : "pet" }));
    box.append(h("h3", {}, "Person or pet ", h("small", {}, "decisions around it")));
    const plot = chancesPlot(box, { label: "Person or pet around this decision", height: 130, isRelative: false });
    plot.cursor = d.t_s;
    const charts = [...maps, plot];
    const paint = () => {
      if (signal.aborted) return;
      for (const map of maps) map.draw(view);
      plot.draw(view, state.decisions);
    };
    paint();
    const timer = setInterval(paint, 500);
    signal.addEventListener("abort", () => {
      clearInterval(timer);
      for (const chart of charts) chart.close();
    });
  };
  const tryDraw = (n) => {
    if (signal.aborted) return;
    const isThere = pictures.axes && pictures.covers(d.t_s - dwell_s, d.t_s);
    if (isThere && (pictures.end_s >= view.to_s - 0.5 || n > 8)) {
      setText(status, "");
      draw();
    } else if (n < 14) {
      setText(status, "Waiting for the pictures …");
      setTimeout(() => tryDraw(n + 1), 200);
    } else {
      setText(
        status,
        "There are no pictures of this moment: they begin half a minute before the page was opened. An alarm's clip has its own, on the events page.",
      );
    }
  };
  tryDraw(0);
}
