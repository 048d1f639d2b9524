// Events: list, filter, replay of a clip's pictures, export, labels.
import { at, get, post } from "../net.js";
import { Pictures } from "../charts/pictures.js";
import { hindrance, markOf, on } from "../state.js";
import { card, clock, day, duration, h, inWords, percent, replace, setText, toast, words } from "../ui.js";
import { ClipPlayer, thumbnail } from "./clip.js";

const LABELS = [
  ["human", "Person"],
  ["pet", "Pet"],
  ["other", "Something else"],
  ["wrong", "Wrong"],
];
const NAMES = Object.fromEntries(LABELS);
const KINDS = { alarm: "Alarm", fault: "Fault", tamper: "Tamper" };
const MANY = { alarm: ["alarm", "alarms"], fault: ["fault", "faults"], tamper: ["tampering", "tamperings"] };
const TEST = /^test alarm: /;
const WEEK = ["Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"];
const MOST = 500;
const SINCE = [
  ["", "any time"],
  ["1h", "last hour"],
  ["24h", "last 24 hours"],
  ["7d", "last 7 days"],
  ["30d", "last 30 days"],
];

// Whether alarms without a label are gone through one after the other; a choice opens the page again.
let isReviewing = false;

export function eventsPage(argument, signal) {
  const page = new EventsPage(argument, signal);
  return { wantsPictures: false, nodes: page.nodes };
}

class EventsPage {
  constructor(chosen, signal) {
    this.signal = signal;
    this.chosen = chosen;
    this.events = [];
    this.list = h("div", { class: "eventlist" });
    this.hours = h("div", { class: "hours", role: "img" });
    this.hoursNote = h("p", { class: "caption" });
    // Named from the start: events may take a while to come.
    this.review = h("button", { type: "button", disabled: true, onclick: () => this.#reviewNext(true) }, "Review alarms");
    this.count = h("p", { class: "quiet", role: "status" });
    this.detail = h("div", { class: "detail" });
    this.filters = this.#filters();
    this.filtered = h("small", {});
    this.filterBox = h("details", { class: "filterbox" }, h("summary", {}, "Filter and export ", this.filtered), this.filters);
    this.when = h("details", {}, h("summary", {}, "When alarms come"), this.hoursNote, this.hours);
    this.filterBox.open = this.when.open = matchMedia("(min-width: 1081px)").matches;
    this.nodes = [
      h("h1", { class: "hidden" }, "Events"),
      h(
        "div",
        { class: "columns events" },
        h("section", { class: "card" }, h("h2", {}, "Events", this.count), this.filterBox, h("p", { class: "buttons" }, this.review), this.list),
        this.detail,
        h("section", { class: "card when" }, this.when),
      ),
    ];
    replace(this.detail, this.#nothingChosen());
    on("event", () => this.#loadSoon(), signal);
    on("now", () => {
      this.#drawReview();
      for (const button of this.detail.querySelectorAll(".labels button")) button.disabled = Boolean(hindrance());
    }, signal);
    addEventListener("keydown", (event) => this.#onKey(event), { signal });
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
    query.set("limit", MOST);
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
    const used = [...this.#query()].map(([, value]) => value).join(", ");
    setText(this.filtered, used ? `showing ${used}` : "");
    const n = this.events.length;
    setText(this.count, n === 1 ? "1 event" : n === MOST ? `the newest ${n} events` : `${n} events`);
    this.#drawReview();
    this.#drawHours();
    this.#drawList();
    if (this.chosen) {
      const event = this.events.find((e) => e.id === this.chosen);
      if (event && this.shown !== this.chosen) this.show(event);
    }
  }

  #unlabelled() {
    return this.events.filter((e) => e.kind === "alarm" && !isTest(e) && !e.label);
  }

  #drawReview() {
    const n = this.#unlabelled().length;
    this.review.disabled = Boolean(hindrance()) || n === 0;
    const what = n === 0 ? "Every alarm here has a label" : `Review next, ${n} without a label`;
    setText(this.review, isReviewing && n ? `Skip this one, ${n} without a label` : what);
  }

  // The next alarm without a label, older than the one that is open; then from the newest again.
  #reviewNext(isSkipping) {
    const left = this.#unlabelled();
    const open = this.events.find((e) => e.id === this.chosen);
    const next = left.find((e) => open && e.began < open.began) ?? left.find((e) => e !== open);
    const one = next ?? (isSkipping ? left[0] : undefined);
    isReviewing = Boolean(one);
    if (one) location.hash = `#/events/${one.id}`;
    this.#drawReview();
    if (!one) toast("Every alarm here has a label");
  }

  // 1 to 4 say what it was.
  #onKey(event) {
    const isTyping = event.target.closest?.("input, select, textarea");
    if (isTyping || event.ctrlKey || event.metaKey || event.altKey) return;
    this.detail.querySelectorAll(".labels button")[Number(event.key) - 1]?.click();
  }

  // When alarms come: by day of the week and hour, of what the filters let through.
  #drawHours() {
    const counts = WEEK.map(() => new Array(24).fill(0));
    const alarms = this.events.filter((e) => e.kind === "alarm" && !isTest(e));
    for (const event of alarms) {
      const date = new Date(event.began);
      counts[(date.getDay() + 6) % 7][date.getHours()] += 1;
    }
    const most = Math.max(1, ...counts.flat());
    const said = [];
    const cells = counts.flatMap((row, k) => [
      h("small", {}, WEEK[k]),
      ...row.map((n, hour) => {
        const text = `${WEEK[k]} ${hour}:00 to ${hour + 1}:00: ${countText("alarm", n)}`;
        if (n) said.push(text);
        const cell = h("i", { title: text, class: n ? "some" : "" }, n && most > 1 ? String(n) : "");
        if (n) cell.style.setProperty("--share", `${25 + (75 * n) / most}%`);
        return cell;
      }),
    ]);
    const axis = [h("small", {}), ...Array.from({ length: 24 }, (_, hour) => h("small", {}, hour % 6 ? "" : String(hour)))];
    const what = this.filters.elements.label.value === "wrong" ? "False alarms" : "Alarms";
    setText(this.hoursNote, `${what} by day and hour. Filter by a label to see when those come.`);
    this.hours.setAttribute("aria-label", `${what} by day and hour: ${said.join("; ") || "none"}`);
    replace(this.hours, ...cells, ...axis);
  }

  #drawList() {
    const focused = document.activeElement?.dataset?.event;
    const groups = [];
    const byDay = new Map();
    for (const event of this.events) {
      const name = day(event.began);
      if (!byDay.has(name)) byDay.set(name, []);
      byDay.get(name).push(event);
    }
    for (const [name, events] of byDay) {
      const counted = Object.keys(MANY)
        .map((kind) => [kind, events.filter((e) => e.kind === kind && !isTest(e)).length])
        .filter(([, n]) => n)
        .map(([kind, n]) => countText(kind, n));
      groups.push(h("h3", {}, name, h("small", {}, counted.join(", "))), ...events.map((e) => this.#item(e)));
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
      h("span", { class: "what" }, h("strong", {}, titleOf(event)), ` ${inWords(event.reason).replace(TEST, "")}`),
      h("span", { class: "badges" }, markOf(event) ? h("span", { class: "pill mark-unreal" }, markOf(event)) : null, event.label ? h("span", { class: "pill" }, NAMES[event.label]) : null, event.has_clip ? h("span", { class: "pill clip", title: "has a clip" }, "clip") : null, event.phase === "end" ? null : h("span", { class: "pill human" }, "on")),
      event.has_picture ? thumbnail(event, this.signal) : null,
    );
  }

  #nothingChosen() {
    return card("One event", null, h("p", { class: "quiet loading" }, "Choose an event to replay what the radar saw and to say what it was."));
  }

  show(event) {
    this.shown = event.id;
    this.detail.classList.add("open");
    const facts = [
      ["Began", `${day(event.began)}, ${clock(event.began)}`],
      ["Lasted", event.ended ? duration(event.lasted_s ?? NaN) : "still on"],
      ["How sure of a person", event.kind === "alarm" ? percent(event.peak) : "–"],
      ["Reason", inWords(event.reason)],
      ["Id", event.id, "exact"],
    ];
    const box = card(titleOf(event), event.sensor);
    box.append(h("a", { class: "button back", href: "#/events" }, "‹ All events"));
    box.append(h("dl", { class: "facts" }, facts.map(([k, v, who]) => h("div", { class: who }, h("dt", {}, k), h("dd", {}, v)))));
    if (event.kind === "alarm" && !isTest(event)) box.append(why(event), this.#labels(event));
    if (event.has_picture) {
      const picture = thumbnail(event, this.signal);
      picture.classList.add("large");
      box.append(h("h3", {}, "What the radar saw ", h("small", {}, "how fast limbs moved above, how far away below")), picture);
    }
    const clip = h("div", {});
    box.append(clip);
    replace(this.detail, box);
    // Where they stand one below the other, what was chosen comes first.
    if (matchMedia("(max-width: 1080px)").matches) scrollTo(0, 0);
    if (event.has_clip) {
      this.#clip(clip, event);
      if (isReviewing) clip.querySelector("button").click();
    } else clip.append(h("p", { class: "quiet" }, "There is no clip of this event."));
  }

  #labels(event) {
    const group = h("div", { class: "labels", role: "group", "aria-label": "What was it?" });
    const buttons = LABELS.map(([label, text], k) =>
      h(
        "button",
        {
          type: "button",
          "aria-pressed": String(event.label === label),
          disabled: Boolean(hindrance()),
          "aria-keyshortcuts": String(k + 1),
          onclick: async () => {
            try {
              await post("/api/v1/labels", { event: event.id, label });
            } catch (error) {
              toast(`Not kept: ${error.message}`, "bad");
              return;
            }
            event.label = label;
            if (isReviewing) {
              this.#reviewNext(false);
              return;
            }
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
    return h("div", { class: "ask" }, h("h3", {}, "What was it? ", h("small", { class: "keys" }, "keys 1 to 4; "), words(h("small", {}, "the sensor can be taught from this"), h("small", {}, "train-export finetune learns from this"))), group);
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

function isTest(event) {
  return Boolean(event.test) || TEST.test(event.reason);
}

function titleOf(event) {
  return isTest(event) ? "Test" : (KINDS[event.kind] ?? event.kind);
}

function countText(kind, n) {
  const [one, several] = MANY[kind];
  return `${n} ${n === 1 ? one : several}`;
}

function why(event) {
  if (event.why === null) {
    const text = "The decision that raised it is not remembered any more; the clip shows what was decided.";
    return h("p", { class: "quiet" }, text);
  }
  return h("p", { class: "buttons" }, h("a", { class: "button", href: `#/why/${event.why}` }, "Why this alarm?"));
}
