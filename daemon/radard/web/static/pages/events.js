// Events: list, filter, replay of a clip's pictures, export, labels.
import { HeatMap, TITLES } from "../charts/heatmap.js";
import { card } from "./live.js";
import { at, get, post } from "../net.js";
import { Pictures } from "../charts/pictures.js";
import { LinePlot } from "../charts/plot.js";
import { isOperator, limit, markOf, on } from "../state.js";
import { clock, day, duration, fixed, h, inWords, minutes, percent, replace, setText, toast, verdict } from "../ui.js";

const LABELS = [
  ["human", "Person"],
  ["pet", "Pet"],
  ["other", "Something else"],
  ["wrong", "Wrong"],
];
const NAMES = Object.fromEntries(LABELS);
const KINDS = { alarm: "Alarm", fault: "Fault", tamper: "Tamper" };
const SINCE = [
  ["", "any time"],
  ["1h", "last hour"],
  ["24h", "last 24 hours"],
  ["7d", "last 7 days"],
  ["30d", "last 30 days"],
];

export function eventsPage(argument, signal) {
  const page = new EventsPage(argument, signal);
  return { wantsPictures: false, nodes: page.nodes };
}

class EventsPage {
  constructor(chosen, signal) {
    this.signal = signal;
    this.chosen = chosen;
    this.list = h("div", { class: "eventlist" });
    this.count = h("p", { class: "quiet", role: "status" });
    this.detail = h("div", { class: "detail" });
    this.filters = this.#filters();
    this.nodes = [
      h("h1", { class: "hidden" }, "Events"),
      h(
        "div",
        { class: "columns events" },
        h("section", { class: "card" }, h("h2", {}, "Events", this.count), this.filters, this.list),
        this.detail,
      ),
    ];
    replace(this.detail, this.#nothingChosen());
    on("event", () => this.#loadSoon(), signal);
    this.load();
  }

  #filters() {
    const change = () => this.load();
    const select = (name, label, options) =>
      h(
        "label",
        {},
        h("span", {}, label),
        h("select", { name, onchange: change }, options.map(([value, text]) => h("option", { value }, text))),
      );
    const form = h(
      "form",
      { class: "filters", onsubmit: (event) => event.preventDefault() },
      select("kind", "Kind", [["", "all"], ...Object.entries(KINDS)]),
      select("since", "Since", SINCE),
      select("label", "Label", [["", "any"], ["none", "not labelled"], ...LABELS]),
      h("label", { class: "wide" }, h("span", {}, "Text"), h("input", { name: "text", type: "search", oninput: () => this.#loadSoon() })),
      h(
        "div",
        { class: "exports" },
        h("a", { class: "button", download: true, "data-format": "csv" }, "Export CSV"),
        h("a", { class: "button", download: true, "data-format": "jsonl" }, "Export JSON"),
      ),
    );
    return form;
  }

  #query() {
    const query = new URLSearchParams();
    for (const [key, value] of new FormData(this.filters)) if (value) query.set(key, value);
    return query;
  }

  #loadSoon() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.load(), 250);
  }

  async load() {
    const query = this.#query();
    for (const link of this.filters.querySelectorAll("a[data-format]")) {
      const export_ = new URLSearchParams(query);
      export_.set("format", link.dataset.format);
      link.href = at(`/api/v1/events/export?${export_}`);
    }
    try {
      this.events = (await get(`/api/v1/events?${query}`)).events;
    } catch (error) {
      setText(this.count, error.message);
      return;
    }
    if (this.signal.aborted) return;
    setText(this.count, this.events.length === 1 ? "1 event" : `${this.events.length} events`);
    this.#drawList();
    if (this.chosen) {
      const event = this.events.find((e) => e.id === this.chosen);
      if (event && this.shown !== this.chosen) this.show(event);
    }
  }

  #drawList() {
    const focused = document.activeElement?.dataset?.event;
    const groups = [];
    let last = "";
    for (const event of this.events) {
      const name = day(event.began);
      if (name !== last) groups.push(h("h3", {}, name));
      last = name;
      groups.push(this.#item(event));
    }
    if (!groups.length) groups.push(h("p", { class: "quiet loading" }, "Nothing has happened, or nothing that fits."));
    replace(this.list, ...groups);
    if (focused) this.list.querySelector(`[data-event="${focused}"]`)?.focus();
  }

  #item(event) {
    return h(
      "a",
      {
        class: `event ${event.kind}`,
        href: `#/events/${event.id}`,
        "data-event": event.id,
        "aria-current": event.id === this.chosen ? "true" : null,
      },
      h("span", { class: "dot" }),
      h("span", { class: "number when" }, clock(event.began)),
      h("span", { class: "what" }, h("strong", {}, KINDS[event.kind] ?? event.kind), ` ${inWords(event.reason)}`),
      h("span", { class: "badges" }, markOf(event) ? h("span", { class: "pill mark-unreal" }, markOf(event)) : null, event.label ? h("span", { class: "pill" }, NAMES[event.label]) : null, event.has_clip ? h("span", { class: "pill clip", title: "has a clip" }, "clip") : null, event.phase === "end" ? null : h("span", { class: "pill human" }, "on")),
    );
  }

  #nothingChosen() {
    return card("One event", null, h("p", { class: "quiet loading" }, "Choose an event to replay what the radar saw and to say what it was."));
  }

  show(event) {
    this.shown = event.id;
    const lasted = event.ended ? (new Date(event.ended) - new Date(event.began)) / 1000 : null;
    const facts = [
      ["Began", `${day(event.began)}, ${clock(event.began)}`],
      ["Lasted", lasted === null ? "still on" : duration(lasted)],
      ["Surest of a person", event.kind === "alarm" ? percent(event.peak) : "–"],
      ["Reason", inWords(event.reason)],
      ["Id", event.id, "exact"],
    ];
    const box = card(KINDS[event.kind] ?? event.kind, event.sensor);
    box.append(h("dl", { class: "facts" }, facts.map(([k, v, who]) => h("div", { class: who }, h("dt", {}, k), h("dd", {}, v)))));
    if (event.kind === "alarm") box.append(this.#labels(event));
    const clip = h("div", {});
    box.append(clip);
    replace(this.detail, box);
    if (event.has_clip) this.#clip(clip, event);
    else clip.append(h("p", { class: "quiet" }, "There is no clip of this event."));
  }

  #labels(event) {
    const group = h("div", { class: "labels", role: "group", "aria-label": "What was it?" });
    const buttons = LABELS.map(([label, text]) =>
      h(
        "button",
        {
          type: "button",
          "aria-pressed": String(event.label === label),
          disabled: !isOperator(),
          onclick: async () => {
            try {
              await post("/api/v1/labels", { event: event.id, label });
            } catch (error) {
              toast(`Not kept: ${error.message}`, "bad");
              return;
            }
            event.label = label;
            for (const [i, button] of buttons.entries()) {
              button.setAttribute("aria-pressed", String(LABELS[i][0] === label));
            }
            this.load();
          },
        },
        text,
      ),
    );
    group.append(...buttons);
    return h("div", { class: "ask" }, h("h3", {}, "What was it? ", h("small", {}, "train-export finetune learns from this")), group);
  }

  async #clip(box, event) {
    const replay = h("button", { type: "button", class: "primary" }, "Replay the pictures");
    const row = h(
      "p",
      { class: "buttons" },
      replay,
      h("a", { class: "button", href: at(`/api/v1/events/${event.id}/clip`), download: true }, "Download the clip"),
    );
    box.append(row);
    replay.addEventListener("click", async () => {
      replay.disabled = true;
      setText(replay, "Making pictures …");
      try {
        const answer = await fetch(at(`/api/v1/events/${event.id}/pictures`));
        if (!answer.ok) throw new Error((await answer.json()).error);
        const clip = Pictures.ofClip(await answer.arrayBuffer());
        if (this.signal.aborted || this.shown !== event.id) return;
        replay.remove();
        box.append(new ClipPlayer(clip, this.signal).element);
      } catch (error) {
        replay.disabled = false;
        setText(replay, "Replay the pictures");
        toast(`No pictures: ${error.message}`, "bad");
      }
    });
  }
}

// Plays a clip's pictures from its beginning, with a slider, a speed and the space bar.
class ClipPlayer {
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
    this.plot = new LinePlot(this.element, {
      label: "Probabilities in the clip",
      height: 120,
      low: 0,
      high: 1,
      unit: "probability",
      isRelative: false,
      series: [
        { key: "fused_p_pet", label: "pet", tone: "pet" },
        { key: "fused_p_human", label: "person", tone: "human" },
      ],
      limits: () => [{ value: limit(), text: `pet above ${fixed(limit(), 2)}: no alarm`, tone: "pet" }],
    });
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
