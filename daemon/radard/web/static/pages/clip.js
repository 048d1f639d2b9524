// A clip of an alarm: its pictures played from its beginning, and the small one of the lists.
import { HeatMap, TITLES } from "../charts/heatmap.js";
import { chancesPlot } from "../charts/plots.js";
import { get } from "../net.js";
import { fixed, h, minutes, setText, verdict } from "../ui.js";

// With a slider, a speed and the space bar.
export class ClipPlayer {
  constructor({ pictures, decisions, length_s }, signal) {
    this.length_s = length_s;
    this.decisions = decisions;
    this.at_s = 0;
    this.isPlaying = true;
    this.play = h("button", { type: "button", class: "icon", onclick: () => this.toggle() });
    this.slider = h("input", {
      type: "range",
      min: "0",
      max: String(length_s),
      step: "0.1",
      "aria-label": "Position in the clip",
      oninput: () => {
        this.at_s = Number(this.slider.value);
        this.isPlaying = false;
      },
    });
    this.time = h("output", { class: "number" });
    this.speed = h("select", { "aria-label": "Speed" }, [0.5, 1, 2, 4].map((s) => h("option", { value: s, selected: s === 1 }, `${s} ×`)));
    this.words = h("p", { class: "clipverdict", "aria-live": "off" });
    this.element = h(
      "div",
      { class: "clip" },
      h("div", { class: "player" }, this.play, this.slider, this.time, this.speed),
      this.words,
    );
    this.maps = ["range", "velocity", "doppler"].map((name) => {
      this.element.append(h("h3", {}, `${TITLES[name][0]} `, h("small", { class: "exact" }, TITLES[name][1])));
      return new HeatMap(this.element, name, pictures, { height: name === "doppler" ? 108 : 136, isRelative: false });
    });
    this.maps[0].marks = decisions
      .filter((d) => d.range_m !== null)
      .map((d) => ({ t_s: d.t_s, value: d.range_m, tone: d.alarm ? "human" : "pet" }));
    this.element.append(h("h3", {}, "Person or pet"));
    this.plot = chancesPlot(this.element, { label: "Person or pet in the clip", height: 120, isRelative: false });
    let last = performance.now();
    const step = (now) => {
      if (signal.aborted || (this.wasShown && !this.element.isConnected)) {
        for (const chart of [...this.maps, this.plot]) chart.close();
        return;
      }
      this.wasShown ||= this.element.isConnected;
      requestAnimationFrame(step);
      this.tick(Math.min(0.2, (now - last) / 1000));
      last = now;
    };
    requestAnimationFrame(step);
  }

  toggle() {
    if (this.at_s >= this.length_s) this.at_s = 0;
    this.isPlaying = !this.isPlaying;
  }

  tick(elapsed_s) {
    if (this.isPlaying) this.at_s += elapsed_s * Number(this.speed.value);
    if (this.at_s >= this.length_s) {
      this.at_s = this.length_s;
      this.isPlaying = false;
    }
    setText(this.play, this.isPlaying ? "❚❚" : "►");
    this.play.setAttribute("aria-label", this.isPlaying ? "Pause" : "Play");
    this.slider.value = String(this.at_s);
    setText(this.time, `${minutes(this.at_s)} / ${minutes(this.length_s)}`);
    const view = { from_s: 0, to_s: Math.max(1, this.length_s) };
    for (const map of this.maps) {
      map.shade = { from_s: -1, to_s: this.at_s };
      map.draw(view);
    }
    this.plot.cursor = this.at_s;
    this.plot.draw(view, this.decisions);
    const now = this.decisions.findLast((d) => d.t_s <= this.at_s);
    setText(this.words, now ? `${verdict({ ...now, label: now.label || null })[0]}${now.range_m === null ? "" : `, ${fixed(now.range_m, 1)} m`}` : "Before the first decision");
  }
}

// The small picture of an event: how its limbs swung above, where it was below, with their axes.
// It is fetched once it comes into sight.
export function thumbnail(event, signal) {
  const box = h("figure", { class: "thumb" });
  const seen = new IntersectionObserver(([entry]) => {
    if (!entry.isIntersecting) return;
    seen.disconnect();
    fill(box, event);
  });
  seen.observe(box);
  signal.addEventListener("abort", () => seen.disconnect());
  return box;
}

const kept = new Map();
const MAX_KEPT = 200;

async function fill(box, event) {
  try {
    if (!kept.has(event.id)) kept.set(event.id, await get(`/api/v1/events/${event.id}/thumbnail`));
  } catch {
    box.remove();
    return;
  }
  if (kept.size > MAX_KEPT) kept.delete(kept.keys().next().value);
  const { png, axes } = kept.get(event.id) ?? {};
  const alt = "Small picture: speed of the limbs above, distance below, over time";
  const image = h("img", { src: png, alt, decoding: "async" });
  if (!axes) {
    box.replaceChildren(image);
    return;
  }
  const { velocity_mps: speed, range_m: range, length_s: length } = axes;
  const edge = (high, low, unit) =>
    h("span", {}, h("b", {}, high), h("i", {}, unit), h("b", {}, low));
  box.replaceChildren(
    h("span", { class: "axis", "aria-hidden": "true" }, edge(`+${fixed(speed[1], 1)}`, fixed(speed[0], 1), "m/s"), edge(fixed(range[1], 1), fixed(range[0], 1), "m")),
    image,
    h("figcaption", {}, h("b", {}, "0"), h("i", {}, "s"), h("b", {}, fixed(length, 0))),
  );
}
