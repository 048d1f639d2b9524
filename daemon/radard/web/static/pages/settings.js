// What may be set without editing a file: sensitivity, delays, how the sensor is mounted.
import { offer } from "../command.js";
import { get, post } from "../net.js";
import { hindrance, on, state, tell } from "../state.js";
import { card, h, replace, setText, toast } from "../ui.js";

const NAMES = { low: "Low", normal: "Normal", high: "High" };

// A form of one section of the settings; `fields` are its inputs by key.
class SettingsForm {
  constructor(section, fields, signal) {
    this.section = section;
    this.fields = fields;
    this.isTouched = false;
    this.isSending = false;
    this.save = offer(h("button", { type: "submit", class: "primary" }, "Save"), signal, () => this.#fault());
    this.buttons = h("p", { class: "buttons" }, ...this.save.nodes);
    this.said = h("p", { role: "status", class: "quiet" });
    this.element = h("form", {
      class: "settings",
      onsubmit: (event) => {
        event.preventDefault();
        this.#send();
      },
      oninput: () => {
        this.isTouched = true;
        setText(this.said, "");
        this.draw();
      },
    });
    on("now", () => this.draw(), signal);
  }

  draw() {
    const now = state.settings?.[this.section];
    for (const { element } of Object.values(this.fields)) {
      element.disabled = Boolean(hindrance()) || !now;
    }
    this.save.draw();
    if (this.isTouched || this.isSending || !now) return;
    for (const [key, { show }] of Object.entries(this.fields)) show(now[key]);
  }

  // Why there is nothing to save, or what is wrong with it.
  #fault() {
    if (!this.isTouched) return "Nothing is changed yet";
    const bad = Object.values(this.fields).map(({ element }) => element).find((e) => !e.checkValidity());
    return bad ? `${bad.getAttribute("aria-label")}: ${bad.validationMessage}` : "";
  }

  async #send() {
    const wanted = {};
    for (const [key, { value }] of Object.entries(this.fields)) wanted[key] = value();
    setText(this.said, "…");
    // What is changed from here on is for the next time.
    this.isTouched = false;
    this.isSending = true;
    this.draw();
    try {
      await post("/api/v1/settings", { [this.section]: wanted });
      state.hasSavedSettings = true;
      tell("now");
      setText(this.said, await told(this.section, wanted));
    } catch (error) {
      this.isTouched = true;
      setText(this.said, "");
      toast(`Not saved: ${error.message}`, "bad");
    }
    this.isSending = false;
    this.draw();
  }
}

// Waits until the daemon works with them; variables and options may win.
async function told(section, wanted) {
  for (let k = 0; k < 30; k += 1) {
    const { settings } = await get("/api/v1/status");
    if (Object.entries(wanted).every(([key, value]) => settings[section][key] === value)) {
      state.settings = settings;
      return "Saved; this holds from now on.";
    }
    await new Promise((done) => setTimeout(done, 100));
  }
  return "Saved, but an environment variable, an option or a fault of the configuration stands before it; see radard config show.";
}

function number(label, unit, note, { min, max, step, isOptional = false }) {
  const input = h("input", { type: "number", min, max, step, required: !isOptional, inputmode: "decimal", "aria-label": label });
  if (isOptional) input.placeholder = "unknown";
  return {
    input,
    row: h("label", { class: "field" }, h("span", {}, label), input, h("span", { class: "quiet" }, unit), h("small", {}, note)),
    field: {
      element: input,
      value: () => (input.value === "" ? null : Number(input.value)),
      show: (value) => {
        input.value = value === null || value === undefined ? "" : String(value);
      },
    },
  };
}

export function alarmSettings(signal) {
  const levels = h("fieldset", { class: "levels" }, h("legend", {}, "Sensitivity"));
  const costs = new Map();
  const radios = Object.entries(NAMES).map(([name, title]) => {
    const cost = h("small", { id: `cost-${name}` });
    costs.set(name, cost);
    const radio = h("input", { type: "radio", name: "sensitivity", value: name, "aria-describedby": `cost-${name}` });
    levels.append(h("label", { class: "level" }, radio, h("span", {}, title), cost));
    return radio;
  });
  const delay = { min: 0, max: 600, step: "any" };
  const entry = number("Entry delay", "s", "from somebody coming in to the alarm: time to disarm", delay);
  const exit = number("Exit delay", "s", "from arming to being armed: time to leave", delay);
  const note = h("p", { class: "quiet" });
  const form = new SettingsForm(
    "alarm",
    {
      sensitivity: {
        element: levels,
        value: () => radios.find((radio) => radio.checked)?.value,
        show: (value) => {
          for (const radio of radios) radio.checked = radio.value === value;
        },
      },
      entry_delay_s: entry.field,
      exit_delay_s: exit.field,
    },
    signal,
  );
  form.element.append(levels, note, entry.row, exit.row, form.buttons, form.said);
  const load = async () => {
    try {
      const { choices, given } = await get("/api/v1/sensitivities");
      for (const choice of choices) replace(costs.get(choice.name), costText(choice));
      const text = `${given.map((key) => `alarm.${key}`).join(", ")} in the configuration goes before the sensitivity.`;
      setText(note, given.length ? text : sayings(choices));
    } catch (error) {
      setText(note, error.message);
    }
  };
  on("hello", load, signal);
  load();
  form.draw();
  return card("Alarm", "when it is raised", form.element);
}

function costText({ made, costs }) {
  if (!made) return costs;
  const share = ([value]) => (value === null ? "?" : `${(100 * value).toPrecision(2)} %`);
  return `misses ${share(made.missed)} of people, alarms at ${share(made.visits_with_alarm)} of pets' visits`;
}

function sayings(choices) {
  const made = choices.find((choice) => choice.made)?.made;
  if (!made) return "";
  return `Measured on ${made.intrusions} simulated people coming in and ${made.pet_visits} visits of pets of 20 s; real ones may fare worse.`;
}

// Gives way to the configuration: what both forms saved.
function forgetting(signal) {
  const button = h("button", { type: "button" }, "Forget these settings");
  const said = h("p", { role: "status", class: "quiet" });
  const { nodes, draw } = offer(button, signal, () => (state.hasSavedSettings ? "" : "Nothing is saved here"));
  button.addEventListener("click", async () => {
    try {
      await post("/api/v1/settings", { forget: true });
      state.hasSavedSettings = false;
      setText(said, "Forgotten. What the configuration says holds again.");
    } catch (error) {
      toast(`Not done: ${error.message}`, "bad");
    }
    draw();
  });
  return h("div", {}, h("p", { class: "buttons" }, ...nodes), said);
}

export function mounting(signal) {
  const height = number("Height above the floor", "m", "of the sensor's face", { min: 0.1, max: 5, step: "any", isOptional: true });
  const tilt = number("Tilt", "°", "downwards; 0 looks straight ahead", { min: -30, max: 60, step: "any", isOptional: true });
  const form = new SettingsForm("mount", { height_m: height.field, tilt_deg: tilt.field }, signal);
  form.element.append(height.row, tilt.row, form.buttons, form.said);
  form.draw();
  return card(
    "Mounting",
    "how the sensor hangs; leave empty what is not known",
    form.element,
    h("h3", {}, "Alarm and mounting ", h("small", {}, "saved here, they go before config.yaml")),
    forgetting(signal),
  );
}
