// Set up: calibrate, walk the room, and draw zones on the range axis.
import { command } from "./app.js";
import { LinePlot } from "./plot.js";
import { card } from "./live.js";
import { isOperator, lastDecision, on, pictures, state } from "./state.js";
import { copy, download, fixed, h, replace, setText } from "./ui.js";
import { ZoneEditor } from "./zones.js";

const LEAVE_S = 15;
const WATCH = 20;
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
  let phase = "";
  let left = 0;
  let watched = [];
  const timer = setInterval(() => {
    const d = lastDecision();
    if (d) plot.draw({ from_s: d.t_s - 60, to_s: d.t_s }, state.decisions);
    if (phase !== "leave") return;
    left -= 0.5;
    bar.value = 100 * (1 - left / LEAVE_S);
    setText(said, `Leave the room now: ${Math.ceil(left)} s`);
    if (left > 0) return;
    command("calibrate");
    phase = "watch";
    watched = [];
  }, 500);
  signal.addEventListener("abort", () => clearInterval(timer));
  button.addEventListener("click", () => {
    phase = phase ? "" : "leave";
    left = LEAVE_S;
    bar.hidden = !phase;
    setText(button, phase ? "Stop" : "Calibrate the empty room");
    setText(said, "");
  });
  on("decision", (d) => {
    if (phase !== "watch") return;
    watched.push(d);
    bar.value = (100 * watched.length) / WATCH;
    setText(said, `Learning and watching: ${watched.length} of ${WATCH} windows`);
    if (watched.length < WATCH) return;
    phase = "";
    bar.hidden = true;
    setText(button, "Calibrate the empty room");
    setText(said, calibrationResult(watched));
  }, signal);
  return box;
}

function calibrationResult(watched) {
  const whole = watched.filter((d) => d.gate !== "invalid");
  const closed = whole.filter((d) => d.gate === "closed");
  const margins = closed.map((d) => d.threshold_db - d.power_db);
  const least = margins.length ? Math.min(...margins) : null;
  if (!whole.length) return "No window could be judged; look at the state above.";
  if (closed.length === whole.length) {
    return `Done. All ${whole.length} windows were quiet, the least ${fixed(least)} dB under the threshold.`;
  }
  return `${closed.length} of ${whole.length} windows were quiet. Something moves: a fan, a curtain, or somebody. Stop it or exclude its range below, and calibrate again.`;
}

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
  const lines = h("pre", { tabindex: "0", "aria-label": "Lines for config.yaml" });
  const draw = () => setText(lines, editor.yaml());
  box.append(
    h("h3", {}, "For config.yaml ", h("small", {}, "then: systemctl reload radard, or kill -HUP")),
    lines,
    h("p", { class: "buttons" }, h("button", { type: "button", onclick: () => copy(editor.yaml()) }, "Copy")),
  );
  editor.onchange = draw;
  draw();
  on("hello", () => {
    // What is being edited stays.
    if (editor.isTouched) return;
    editor.reset(swath(), state.zones);
    draw();
  }, signal);
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
