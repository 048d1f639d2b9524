// Set up: calibrate, walk the room, choose what makes an alarm and who hears of it, draw zones.
import { command, offer } from "../command.js";
import { powerPlot } from "../charts/plots.js";
import { get, post } from "../net.js";
import { hindrance, lastDecision, on, pictures, state, swath } from "../state.js";
import { card, copy, day, fixed, h, setText, toast, words } from "../ui.js";
import { news } from "./news.js";
import { alarmSettings, mounting } from "./settings.js";
import { walkTest, walkedSpan } from "./walk.js";
import { ZoneEditor } from "./zones.js";

export function setupPage(_argument, signal) {
  const first = [calibration(signal), walkTest(signal)];
  const second = [alarmSettings(signal), mounting(signal)];
  const last = [zones(signal), news(signal)];
  const links = [...first, ...second, ...last].map((part) => {
    const title = part.querySelector("h2").firstChild.textContent;
    return h("button", { type: "button", onclick: () => part.scrollIntoView({ block: "start" }) }, title);
  });
  return {
    wantsPictures: true,
    nodes: [
      h("h1", { class: "hidden" }, "Set up"),
      h("nav", { class: "contents", "aria-label": "On this page" }, links),
      h("div", { class: "columns setup" }, h("div", { class: "stack" }, first), h("div", { class: "stack" }, second)),
      ...last,
    ],
  };
}

// Calibration ------------------------------------------------------------------------------

function calibration(signal) {
  const button = h("button", { type: "button", class: "primary" }, "Calibrate the empty room");
  const said = h("p", { role: "status" });
  const bar = h("progress", { max: "100", value: "0", hidden: true, "aria-label": "Calibration" });
  const box = card(
    "Calibration",
    "what the room looks like with nobody in it",
    h("p", { class: "quiet" }, "The radar learns the echoes of walls and furniture and the level of its own noise. Do this once it is mounted, and again when furniture has moved."),
    h("p", { class: "buttons" }, ...offer(button, signal).nodes),
    bar,
    said,
    h("h3", {}, "Motion ", words(h("small", {}, "in an empty room it stays under the dashed line"), h("small", {}, "an empty room stays under the threshold"))),
  );
  const plot = powerPlot(box, { label: "Motion over the last minute", height: 150 });
  signal.addEventListener("abort", () => plot.close());
  let asked = false;
  let most = 1;
  const timer = setInterval(() => {
    const d = lastDecision();
    if (d) plot.draw({ from_s: d.t_s - 60, to_s: d.t_s }, state.decisions);
  }, 500);
  signal.addEventListener("abort", () => clearInterval(timer));
  button.addEventListener("click", () => {
    asked = true;
    command("calibrate");
    follow();
  });
  function follow() {
    const { phase = "", left_s: left = 0, text = "" } = state.panel.calibration ?? {};
    const isBusy = phase === "leave" || phase === "listen";
    setText(button, isBusy ? "Begin again" : "Calibrate the empty room");
    bar.hidden = phase !== "listen";
    if (phase === "listen") most = Math.max(most, left);
    else most = 1;
    bar.value = 100 * (1 - left / most);
    if (phase) setText(said, CALIBRATION[phase](left, text));
    else if (asked && state.playback) setText(said, "It learns the room again; a replay keeps no calibration.");
  }
  on("now", follow, signal);
  follow();
  return box;
}

const CALIBRATION = {
  leave: (left) => `Leave the room now: ${left} s`,
  listen: (left) => `Listening to the empty room: ${left} s`,
  made: (_left, text) => `Calibrated ${text}.`,
  failed: (_left, text) => `Not calibrated: ${text}. What held before still holds.`,
};

// Zones ------------------------------------------------------------------------------------

function zones(signal) {
  const box = card("Zones", "which ranges raise an alarm; decisions are made everywhere");
  const editor = new ZoneEditor(box, swath(), state.zones);
  const said = h("p", { role: "status", class: "quiet" });
  const lines = h("pre", { tabindex: "0", "aria-label": "Lines for config.yaml" });
  const save = h("button", { type: "button", class: "primary" }, "Save the zones");
  const forget = h("button", { type: "button" }, "Forget what was saved");
  const suggest = h("button", { type: "button" }, "Suggest zones");
  const undo = h("button", { type: "button", hidden: true }, "Undo the changes");
  const offers = [
    offer(save, signal, () => (editor.isTouched ? "" : "Nothing is changed yet")),
    offer(forget, signal, () => (state.hasSavedZones ? "" : "Nothing is saved here")),
  ];
  const draw = () => {
    setText(lines, editor.yaml());
    undo.hidden = !editor.isTouched;
    suggest.disabled = Boolean(hindrance(true));
    for (const each of offers) each.draw();
  };
  const begin = () => {
    // What is being edited stays.
    if (!editor.isTouched) editor.reset(swath(), state.zones);
    draw();
  };
  const send = async (body, isSaved) => {
    // The editor follows the daemon from here on, so what it shows is what holds.
    editor.isTouched = false;
    setText(said, "…");
    draw();
    try {
      await post("/api/v1/zones", body);
      state.hasSavedZones = isSaved;
      setText(said, await told(body));
    } catch (error) {
      editor.isTouched = isSaved;
      setText(said, "");
      toast(`Not saved: ${error.message}`, "bad");
    }
    begin();
  };
  save.addEventListener("click", () => send(editor.spans(), true));
  forget.addEventListener("click", () => send({ forget: true }, false));
  suggest.addEventListener("click", async () => {
    const found = await suggestions();
    editor.suggest(found.spans);
    setText(said, found.text);
  });
  undo.addEventListener("click", () => {
    editor.isTouched = false;
    setText(said, "");
    begin();
  });
  box.append(
    h("p", { class: "buttons" }, suggest, undo, ...offers.flatMap(({ nodes }) => nodes)),
    said,
    h(
      "div",
      { class: "exact" },
      h("h3", {}, "For config.yaml ", h("small", {}, "instead of saving here, or for another sensor")),
      lines,
      h("p", { class: "buttons" }, h("button", { type: "button", onclick: () => copy(editor.yaml()) }, "Copy")),
    ),
  );
  editor.onchange = () => {
    setText(said, "");
    draw();
  };
  draw();
  on("hello", begin, signal);
  on("zones", begin, signal);
  on("now", draw, signal);
  on("decision", (d) => editor.setTargets(d), signal);
  const timer = setInterval(() => {
    if (pictures.axes) editor.setProfile(pictures.lastColumn("range"), pictures.by.get("range"));
  }, 150);
  signal.addEventListener("abort", () => {
    clearInterval(timer);
    editor.close();
  });
  return box;
}

// What the calibration and the last walk of this page speak for; nothing is saved by it.
async function suggestions() {
  const spans = [];
  const texts = [];
  const range = ([from, to]) => `${fixed(from, 1)} to ${fixed(to, 1)} m`;
  let calibrated = null;
  try {
    calibrated = await get("/api/v1/calibration");
  } catch (error) {
    texts.push(`The calibration cannot be read: ${error.message}.`);
  }
  if (!calibrated) texts.push("This sensor keeps no calibration yet.");
  else if (!calibrated.restless.length) texts.push("In the calibrated room nothing moves by itself.");
  for (const span of calibrated?.restless ?? []) {
    spans.push({ kind: "exclude", span });
    texts.push(`At ${range(span)} something moved in the empty room (calibrated ${day(calibrated.made_utc)}).`);
  }
  const walked = walkedSpan();
  if (walked) {
    spans.push({ kind: "include", span: walked });
    texts.push(`You were taken for a person from ${range(walked)}.`);
  } else {
    texts.push("A walk test would say how far the alarm should reach.");
  }
  if (spans.length) texts.push("This is drawn in place of what was there of its kind; nothing is saved until you save it.");
  return { spans, text: texts.join(" ") };
}

// Waits until the daemon works with zones, and says so; variables and options may win.
async function told(body) {
  if (body.forget) return "Forgotten. What the configuration says holds again.";
  const wanted = JSON.stringify(body);
  for (let k = 0; k < 30; k += 1) {
    const { zones: now } = await get("/api/v1/status");
    if (JSON.stringify({ include: now.include, exclude: now.exclude, away: now.away }) === wanted) {
      return "Saved. The alarm follows them from now on.";
    }
    await new Promise((done) => setTimeout(done, 100));
  }
  return "Saved, but an environment variable, an option or a fault of the configuration stands before it; see radard config show.";
}
