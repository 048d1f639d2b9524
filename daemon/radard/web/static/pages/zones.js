// The range axis with zones on it: drag their ends, or type them.
import { Chart, colour } from "../charts/chart.js";
import { fixed, h, replace } from "../ui.js";

const MIN_M = 0.1;
const KINDS = { include: "Only here", exclude: "Not here", away: "Not while at home" };
const TONES = { include: "pet", exclude: "human", away: "other" };

class RangeAxis extends Chart {
  draw(editor) {
    const c = this.begin(editor);
    const { x, y, w, h: height } = this.box;
    this.view = { from_s: editor.swath.near, to_s: editor.swath.far };
    const bottom = y + height;
    if (editor.profile) {
      const { values, picture } = editor.profile;
      c.beginPath();
      c.moveTo(this.x(picture.first), bottom);
      values.forEach((value, row) => {
        c.lineTo(this.x(picture.first + row * picture.step), bottom - (value / 255) * (height - 8));
      });
      c.lineTo(this.x(picture.first + (values.length - 1) * picture.step), bottom);
      c.closePath();
      c.fillStyle = colour("accent");
      c.globalAlpha = 0.35;
      c.fill();
      c.globalAlpha = 1;
    }
    const named = [];
    for (const zone of editor.zones) {
      const left = this.x(zone.from);
      const right = this.x(zone.to);
      c.globalAlpha = 0.22;
      c.fillStyle = colour(TONES[zone.kind]);
      c.fillRect(left, y, right - left, height);
      c.globalAlpha = 1;
      c.fillRect(left - 1, y, 2, height);
      c.fillRect(right - 1, y, 2, height);
      c.fillRect(left - 4, y + height / 2 - 10, 8, 20);
      c.fillRect(right - 4, y + height / 2 - 10, 8, 20);
      named.push({ text: KINDS[zone.kind], middle: (left + right) / 2 });
    }
    this.drawNames(c, named);
    for (const { range_m, isHeeded } of editor.targets) {
      c.beginPath();
      c.arc(Math.min(Math.max(this.x(range_m), x), x + w), bottom - 14, 6, 0, 2 * Math.PI);
      c.fillStyle = colour(isHeeded ? "human" : "dim");
      c.strokeStyle = colour("panel");
      c.lineWidth = 2;
      c.fill();
      c.stroke();
    }
    this.drawRange(c);
  }

  // Each on the first line on which it meets no other.
  drawNames(c, named) {
    const { x, y, w } = this.box;
    const ends = [];
    c.fillStyle = colour("ink");
    c.textAlign = "left";
    c.textBaseline = "top";
    for (const { text, middle } of named.sort((a, b) => a.middle - b.middle)) {
      const width = c.measureText(text).width;
      const left = Math.min(Math.max(middle - width / 2, x + 2), x + w - width - 2);
      let line = ends.findIndex((end) => end < left);
      if (line < 0) line = ends.length;
      ends[line] = left + width + 8;
      c.fillText(text, left, y + 4 + 14 * line);
    }
  }

  drawRange(c) {
    const { from_s: near, to_s: far } = this.view;
    c.fillStyle = colour("dim");
    c.textAlign = "center";
    c.textBaseline = "top";
    const step = far - near > 5 ? 1 : 0.5;
    for (let k = Math.ceil(near / step); k * step <= far; k += 1) {
      const x = this.x(k * step);
      c.fillRect(Math.round(x), this.box.y + this.box.h, 1, 3);
      c.fillText(`${fixed(k * step, step < 1 ? 1 : 0)} m`, x, this.box.y + this.box.h + 6);
    }
  }
}

export class ZoneEditor {
  constructor(host, swath, zones) {
    this.onchange = () => {};
    this.axis = new RangeAxis(host, {
      label: "Zones on the range axis",
      height: 132,
      margin: { left: 12, right: 12 },
    });
    this.axis.canvas.classList.add("zones");
    this.rows = h("div", { class: "zonerows" });
    host.append(
      h(
        "p",
        { class: "caption dots" },
        h("span", { class: "swatch human" }),
        "moves where it counts",
        h("span", { class: "swatch" }),
        "moves where it does not",
      ),
      this.rows,
      h(
        "p",
        { class: "buttons" },
        h("button", { type: "button", onclick: () => this.add("exclude") }, "Exclude a range"),
        h("button", { type: "button", onclick: () => this.add("include") }, "Alarm only in a range"),
        h("button", { type: "button", onclick: () => this.add("away") }, "No alarm here while at home"),
      ),
    );
    this.targets = [];
    this.profile = null;
    this.isTouched = false;
    this.axis.canvas.addEventListener("pointerdown", (event) => this.#grab(event));
    this.reset(swath, zones);
  }

  close() {
    this.axis.close();
  }

  reset(swath, zones) {
    this.swath = swath;
    this.zones = Object.keys(KINDS).flatMap((kind) => zones[kind].map(([from, to]) => ({ kind, from, to })));
    this.#drawRows();
  }

  setTargets(d) {
    const ranges = d.tracks.length ? d.tracks.map((t) => t.range_m) : [d.range_m];
    this.targets = ranges.filter((r) => r !== null).map((range_m) => ({ range_m, isHeeded: this.heeds(range_m) }));
  }

  setProfile(values, picture) {
    this.profile = values ? { values, picture } : null;
    this.axis.draw(this);
  }

  heeds(range_m) {
    const isIn = (kind) => this.zones.some((z) => z.kind === kind && z.from <= range_m && range_m <= z.to);
    const hasInclude = this.zones.some((z) => z.kind === "include");
    return (!hasInclude || isIn("include")) && !isIn("exclude");
  }

  // Rounded as they are shown and kept.
  spans() {
    const list = (kind) =>
      this.zones.filter((z) => z.kind === kind).map((z) => [Number(z.from.toFixed(2)), Number(z.to.toFixed(2))]);
    return { include: list("include"), exclude: list("exclude"), away: list("away") };
  }

  yaml() {
    const list = (spans) => spans.map(([from, to]) => `[${from.toFixed(2)}, ${to.toFixed(2)}]`).join(", ");
    const { include, exclude, away } = this.spans();
    const atHome = away.length ? `\n  away: [${list(away)}]` : "";
    return `zones:\n  include: [${list(include)}]\n  exclude: [${list(exclude)}]${atHome}`;
  }

  // Puts suggested zones in place of those of their kinds.
  suggest(spans) {
    if (!spans.length) return;
    const kinds = new Set(spans.map(({ kind }) => kind));
    this.zones = this.zones.filter(({ kind }) => !kinds.has(kind));
    for (const { kind, span: [from, to] } of spans) this.zones.push({ kind, from, to });
    this.#changed(true);
  }

  // Adds a zone to edit, in the middle.
  add(kind) {
    const { near, far } = this.swath;
    const middle = (near + far) / 2;
    const half = (far - near) / (kind === "include" ? 3 : 10);
    this.zones.push({ kind, from: middle - half, to: middle + half });
    this.#changed(true);
  }

  #changed(hasNewRows) {
    this.isTouched = true;
    if (hasNewRows) this.#drawRows();
    else this.#fillRows();
    this.axis.draw(this);
    this.onchange();
  }

  #drawRows() {
    replace(
      this.rows,
      ...this.zones.map((zone) => {
        const input = (key, label) =>
          h("input", {
            type: "number",
            step: "0.05",
            min: "0",
            "data-key": key,
            "aria-label": `${KINDS[zone.kind]}, ${label}, metres`,
            value: zone[key].toFixed(2),
            onchange: (event) => {
              const value = Number(event.target.value);
              if (Number.isFinite(value)) this.#move(zone, key, value);
            },
          });
        return h(
          "div",
          { class: `zonerow ${zone.kind}` },
          h("span", { class: "swatch" }),
          h("span", {}, KINDS[zone.kind]),
          input("from", "from"),
          h("span", { class: "quiet" }, "to"),
          input("to", "to"),
          h("span", { class: "quiet" }, "m"),
          h("button", { type: "button", class: "icon", "aria-label": `Remove ${KINDS[zone.kind]} ${fixed(zone.from)} to ${fixed(zone.to)} m`, onclick: () => this.#remove(zone) }, "×"),
        );
      }),
    );
  }

  #fillRows() {
    this.zones.forEach((zone, i) => {
      for (const input of this.rows.children[i].querySelectorAll("input")) {
        input.value = zone[input.dataset.key].toFixed(2);
      }
    });
  }

  #remove(zone) {
    this.zones = this.zones.filter((z) => z !== zone);
    this.#changed(true);
  }

  #move(zone, key, value) {
    const rounded = Math.round(value * 100) / 100;
    if (key === "from") zone.from = Math.max(0, Math.min(rounded, zone.to - MIN_M));
    else zone.to = Math.max(zone.from + MIN_M, rounded);
    this.#changed(false);
  }

  // The nearest end of a zone follows the pointer.
  #grab(event) {
    const { canvas } = this.axis;
    const bounds = canvas.getBoundingClientRect();
    const { x, w } = this.axis.box;
    const { near, far } = this.swath;
    const place = (e) => near + ((e.clientX - bounds.left - x) / w) * (far - near);
    const reach = (16 / w) * (far - near);
    let best = null;
    for (const zone of this.zones) {
      for (const key of ["from", "to"]) {
        const off = Math.abs(zone[key] - place(event));
        if (off < reach && (!best || off < best.off)) best = { zone, key, off };
      }
    }
    if (!best) return;
    event.preventDefault();
    canvas.setPointerCapture(event.pointerId);
    const move = (e) => this.#move(best.zone, best.key, Math.min(far, Math.max(near, place(e))));
    canvas.addEventListener("pointermove", move);
    canvas.addEventListener("pointerup", () => canvas.removeEventListener("pointermove", move), { once: true });
  }
}
