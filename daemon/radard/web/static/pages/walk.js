// Walk test: where a person is noticed, and whether that is everywhere.
import { command, offer } from "../command.js";
import { hindrance, isOperator, on, state, swath } from "../state.js";
import { card, download, fixed, h, replace, setText } from "../ui.js";

const CELL_M = 0.5;
// As `radard walktest`: between sightings so far apart, nobody knows where the walker was.
const LONGEST_GAP_S = 10;
// The rule of radard/commands/walktest.py: so many of the decisions in a stretch see the walker
// and take them for a person, and nobody passes through it unseen.
const MIN_SEEN = 0.9;
const MIN_HUMAN = 0.5;
const MIN_CELLS = 3;

let last = null;

export function walkTest(signal) {
  const button = h("button", { type: "button", class: "primary" }, "Start the walk test");
  const save = h("button", { type: "button", disabled: true }, "Save the report");
  const arming = h("button", { type: "button", hidden: true }, "Disarm");
  const said = h("p", { role: "status" }, "");
  const verdict = h("p", { class: "verdict", role: "status", hidden: true });
  const cells = h("div", { class: "coverage", role: "img", "aria-label": "Nothing walked yet" });
  const box = card(
    "Walk test",
    "where a person is noticed",
    h("p", { class: "quiet" }, "Start it, then walk the room: slowly, straight towards the radar and back, and along the edges. While the sensor is armed this raises the alarm."),
    h("p", { class: "buttons" }, ...offer(button, signal, () => "", { isForAll: true }).nodes, arming, save),
    verdict,
    said,
    h("h3", {}, "By distance ", h("small", {}, "filled: taken for a person; outlined: seen only")),
    cells,
  );
  let test = null;
  let hasDisarmed = false;
  const drawArming = () => {
    const isArmed = Boolean(state.panel.armed);
    const offersDisarm = isArmed && !hasDisarmed;
    const offersArm = !isArmed && hasDisarmed;
    arming.hidden = !isOperator() || !(offersDisarm || offersArm);
    arming.disabled = Boolean(hindrance());
    setText(arming, offersDisarm ? "Disarm for the test" : "Arm again");
  };
  arming.addEventListener("click", () => {
    const isArmed = Boolean(state.panel.armed);
    hasDisarmed = isArmed;
    command(isArmed ? "disarm" : "arm");
  });
  const draw = () => {
    replace(cells, ...rows(test));
    if (test) cells.setAttribute("aria-label", summary(test));
  };
  const judge = () => {
    const { isPass, text } = judged(test);
    verdict.hidden = false;
    verdict.dataset.pass = String(isPass);
    replace(verdict, h("strong", {}, isPass ? "Passed. " : "Not passed. "), text);
    setText(said, summary(test));
  };
  button.addEventListener("click", () => {
    if (test?.isOn) {
      test.isOn = false;
      save.disabled = false;
      judge();
    } else {
      test = { isOn: true, cells: new Map(), began: new Date().toISOString(), windows: [], unseen: [], at: null };
      last = test;
      verdict.hidden = true;
      setText(said, "Walk.");
    }
    setText(button, test.isOn ? "Stop" : "Start the walk test");
    draw();
  });
  save.addEventListener("click", () => {
    const { began, windows, cells: walked } = test;
    const { near } = swath();
    const report = { began, sensor: state.sensor, model: state.hello.model, cell_m: CELL_M, ...judged(test), windows };
    report.cells = [...walked].map(([k, cell]) => ({ from_m: near + k * CELL_M, ...cell }));
    download("walk-test.json", JSON.stringify(report, null, 1), "application/json");
  });
  on("decision", (d) => {
    if (!test?.isOn) return;
    take(test, d);
    if (test.at?.t_s === d.t_s) {
      setText(said, `${d.alarm ? "Person" : "Seen, not taken for a person"} at ${fixed(test.at.range, 1)} m`);
    }
    draw();
  }, signal);
  on("now", drawArming, signal);
  on("hello", draw, signal);
  drawArming();
  draw();
  return box;
}

// The distances from the nearest to the farthest stretch that passed, if enough did.
export function walkedSpan() {
  if (!last) return null;
  const { near, far } = swath();
  const good = [...last.cells].filter(([, cell]) => isGood(cell)).map(([k]) => k);
  if (good.length < MIN_CELLS) return null;
  return [near + Math.min(...good) * CELL_M, Math.min(far, near + (Math.max(...good) + 1) * CELL_M)];
}

// A decision of the walk. One without a sighting counts where the walker must have been: on the
// straight way between the sightings before and after.
function take(test, d) {
  if (d.gate === "invalid") return;
  if (d.gate !== "open" || d.range_m === null) {
    test.unseen.push(d.t_s);
    return;
  }
  const range = d.tracks[0]?.range_m ?? d.range_m;
  const passed = new Set([cellOf(range)]);
  if (test.at && d.t_s - test.at.t_s <= LONGEST_GAP_S) {
    const speed = (range - test.at.range) / (d.t_s - test.at.t_s);
    const ends = [cellOf(test.at.range), cellOf(range)];
    for (const t_s of test.unseen) {
      const k = cellOf(test.at.range + speed * (t_s - test.at.t_s));
      at(test, k).windows += 1;
      if (!ends.includes(k)) at(test, k).missed += 1;
    }
    // A decision is of all the way since the last one: who walks fast leaves no stretch out.
    if (!test.unseen.length) {
      const [a, b] = [cellOf(test.at.range), cellOf(range)];
      for (let k = Math.min(a, b) + 1; k < Math.max(a, b); k += 1) passed.add(k);
    }
  }
  test.unseen = [];
  test.at = { t_s: d.t_s, range };
  for (const k of passed) {
    const cell = at(test, k);
    cell.windows += 1;
    cell.seen += 1;
    cell.human += d.alarm ? 1 : 0;
  }
  test.windows.push({ t_s: d.t_s, range_m: range, label: d.label, p_human: d.fused_p_human, alarm: d.alarm });
}

function cellOf(range) {
  return Math.max(0, Math.floor((range - swath().near) / CELL_M));
}

function at(test, k) {
  if (!test.cells.has(k)) test.cells.set(k, { windows: 0, seen: 0, human: 0, missed: 0 });
  return test.cells.get(k);
}

function isGood(cell) {
  const isSeen = cell.seen >= MIN_SEEN * cell.windows && !cell.missed;
  return isSeen && cell.human >= MIN_HUMAN * cell.windows;
}

function stretch(k) {
  const { near, far } = swath();
  const from = near + k * CELL_M;
  return `${fixed(from, 1)}–${fixed(Math.min(far, from + CELL_M), 1)} m`;
}

function rows(test) {
  const { near, far } = swath();
  const n = Math.max(1, Math.ceil((far - near) / CELL_M));
  return Array.from({ length: n }, (_, k) => {
    const cell = test?.cells.get(k);
    const fill = h("i", {});
    fill.style.width = cell ? `${(100 * cell.human) / cell.windows}%` : "0%";
    const text = cell ? `${cell.human} of ${cell.windows} times` : "not walked";
    return h("div", { class: cell ? "seen" : "" }, h("span", { class: "number" }, stretch(k)), h("b", {}, fill), h("span", { class: "quiet" }, text));
  });
}

// Whether all of the walk, from its nearest to its farthest stretch, was noticed.
function judged(test) {
  const walked = [...test.cells.keys()].sort((a, b) => a - b);
  if (walked.length < MIN_CELLS) {
    return { isPass: false, text: `Walk at least ${fixed(MIN_CELLS * CELL_M, 1)} m of its range; ${walked.length ? "this was less" : "nobody was seen"}.` };
  }
  const [first, end] = [walked[0], walked[walked.length - 1]];
  const bad = [];
  const left = [];
  for (let k = first; k <= end; k += 1) {
    const cell = test.cells.get(k);
    if (!cell) left.push(stretch(k));
    else if (!isGood(cell)) bad.push(stretch(k));
  }
  const all = `${stretch(first).split("–")[0]} to ${stretch(end).split("–")[1]}`;
  if (left.length && !bad.length) return { isPass: false, text: `Nobody walked at ${left.join(", ")}.` };
  if (!bad.length) return { isPass: true, text: `From ${all} you were seen, and taken for a person at least half of the time.` };
  return { isPass: false, text: `You were not seen, or taken for a person less than half of the time, at ${bad.join(", ")}. Mount it otherwise, or choose a higher sensitivity.` };
}

function summary(test) {
  const cells = [...test.cells.values()];
  const looks = cells.reduce((sum, cell) => sum + cell.windows, 0);
  return `${looks} decisions in ${cells.length} stretches of ${fixed(CELL_M, 1)} m; good enough in ${cells.filter(isGood).length} of them.`;
}
