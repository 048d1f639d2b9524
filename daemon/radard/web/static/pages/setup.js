// Set up: calibrate, walk the room, and draw zones on the range axis.
import { command } from "../command.js";
import { LinePlot } from "../charts/plot.js";
import { card } from "./live.js";
import { get, post } from "../net.js";
import { isOperator, lastDecision, on, pictures, state } from "../state.js";
import { copy, download, fixed, h, replace, setText, toast } from "../ui.js";
import { ZoneEditor } from "./zones.js";

const CELL_M = 0.5;

export function setupPage(_argument, signal) {
  return {
    wantsPictures: true,
    nodes: [
      h("h1", { class: "hidden" }, "Set up"),
      h("div", { class: "columns setup" }, calibration(signal), walkTest(signal)),
      zones(signal),
    ],
  };
}

// Calibration ------------------------------------------------------------------------------

function calibration(signal) {
  const button = h("button", { type: "button", class: "primary", disabled: !isOperator() }, "Calibrate the empty room");
  const said = h("p", { role: "status" });
  const bar = h("progress", { max: "100", value: "0", hidden: true, "aria-label": "Calibration" });
  const box = card(
    "Calibration",
    "what the room looks like with nobody in it",
    h("p", { class: "quiet" }, "The radar learns the echoes of walls and furniture and the level of its own noise. Do this once it is mounted, and again when furniture has moved."),
    h("p", { class: "buttons" }, button),
    bar,
    said,
    h("h3", {}, "Motion ", h("small", {}, "an empty room stays under the threshold")),
  );
  const plot = new LinePlot(box, {
    label: "Gate power over the last minute",
    height: 150,
    unit: "dB",
    series: [
      { key: "threshold_db", label: "threshold", tone: "dim", width: 1.2, dash: [4, 4], hasDots: false, digits: 1 },
      { key: "noise_floor_db", label: "floor", tone: "faint", width: 1, hasDots: false, digits: 1 },
      { key: "power_db", label: "power", tone: "accent", digits: 1 },
    ],
  });
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

// Walk test --------------------------------------------------------------------------------

function walkTest(signal) {
  const button = h("button", { type: "button", class: "primary" }, "Start the walk test");
  const save = h("button", { type: "button", disabled: true }, "Save the report");
  const said = h("p", { role: "status" }, "");
  const cells = h("div", { class: "coverage", role: "img", "aria-label": "Nothing walked yet" });
  const box = card(
    "Walk test",
    "where a person is noticed",
    h("p", { class: "quiet" }, "Start it, then walk the room: slowly, straight towards the radar, and along the edges. Disarm first, or it will raise the alarm."),
    h("p", { class: "buttons" }, button, save),
    said,
    h("h3", {}, "By range ", h("small", {}, "filled: taken for a person; outlined: seen only")),
    cells,
  );
  let test = null;
  const draw = () => {
    const { near, far } = swath();
    const n = Math.max(1, Math.ceil((far - near) / CELL_M));
    const rows = Array.from({ length: n }, (_, k) => {
      const from = near + k * CELL_M;
      const cell = test?.cells.get(k) ?? { seen: 0, human: 0 };
      const share = cell.seen ? cell.human / cell.seen : 0;
      const fill = h("i", {});
      fill.style.width = `${100 * share}%`;
      const text = cell.seen ? `${cell.human} of ${cell.seen} person` : "not walked";
      return h("div", { class: cell.seen ? "seen" : "" }, h("span", { class: "number" }, `${fixed(from, 1)}–${fixed(Math.min(far, from + CELL_M), 1)} m`), h("b", {}, fill), h("span", { class: "quiet" }, text));
    });
    replace(cells, ...rows);
    if (test) cells.setAttribute("aria-label", summary(test, n));
  };
  button.addEventListener("click", () => {
    const isOn = test?.isOn;
    if (isOn) {
      test.isOn = false;
      save.disabled = false;
      setText(said, summary(test, cells.childElementCount));
    } else {
      test = { isOn: true, cells: new Map(), began: new Date().toISOString(), windows: [], alarms: 0 };
      setText(said, "Walk.");
    }
    setText(button, test.isOn ? "Stop" : "Start the walk test");
    draw();
  });
  save.addEventListener("click", () => {
    const report = { ...test, cell_m: CELL_M, near_m: swath().near, sensor: state.sensor, model: state.hello.model };
    report.cells = [...test.cells].map(([k, cell]) => ({ from_m: swath().near + k * CELL_M, ...cell }));
    download("walk-test.json", JSON.stringify(report, null, 1), "application/json");
  });
  on("decision", (d) => {
    if (!test?.isOn || d.gate !== "open" || d.range_m === null) return;
    const range = d.tracks[0]?.range_m ?? d.range_m;
    const k = Math.max(0, Math.floor((range - swath().near) / CELL_M));
    const cell = test.cells.get(k) ?? { seen: 0, human: 0 };
    cell.seen += 1;
    cell.human += d.alarm ? 1 : 0;
    test.cells.set(k, cell);
    test.windows.push({ t_s: d.t_s, range_m: range, label: d.label, p_human: d.fused_p_human });
    setText(said, `${d.alarm ? "Person" : "Seen, not taken for a person"} at ${fixed(range, 1)} m`);
    draw();
  }, signal);
  on("hello", draw, signal);
  draw();
  return box;
}

function swath() {
  const { range_offset_m = 0.6, bin_length_m = 0.00366, n_range = 768 } = state.hello;
  return { near: range_offset_m, far: range_offset_m + bin_length_m * n_range };
}

function summary(test, n) {
  const walked = [...test.cells.values()];
  const good = walked.filter((c) => c.human / c.seen >= 0.5).length;
  const windows = walked.reduce((sum, c) => sum + c.seen, 0);
  return `${windows} windows in ${walked.length} of ${n} range cells; in ${good} of them most were taken for a person.`;
}

// Zones ------------------------------------------------------------------------------------

function zones(signal) {
  const box = card("Zones", "which ranges raise an alarm; decisions are made everywhere");
  const editor = new ZoneEditor(box, swath(), state.zones);
  const said = h("p", { role: "status", class: "quiet" });
  const lines = h("pre", { tabindex: "0", "aria-label": "Lines for config.yaml" });
  const save = h("button", { type: "button", class: "primary" }, "Save the zones");
  const forget = h("button", { type: "button" }, "Forget what was saved");
  const draw = () => {
    setText(lines, editor.yaml());
    save.disabled = !isOperator() || !editor.isTouched;
    forget.disabled = !isOperator() || !state.hasSavedZones;
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
  box.append(
    h("p", { class: "buttons" }, save, forget),
    said,
    h("h3", {}, "For config.yaml ", h("small", {}, "instead of saving here, or for another sensor")),
    lines,
    h("p", { class: "buttons" }, h("button", { type: "button", onclick: () => copy(editor.yaml()) }, "Copy")),
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

// Waits until the daemon works with zones, and says so; variables and options may win.
async function told(body) {
  if (body.forget) return "Forgotten. What the configuration says holds again.";
  const wanted = JSON.stringify(body);
  for (let k = 0; k < 30; k += 1) {
    const { zones: now } = await get("/api/v1/status");
    if (JSON.stringify({ include: now.include, exclude: now.exclude }) === wanted) {
      return "Saved. The alarm follows them from now on.";
    }
    await new Promise((done) => setTimeout(done, 100));
  }
  return "Saved, but an environment variable, an option or a fault of the configuration stands before it; see radard config show.";
}
