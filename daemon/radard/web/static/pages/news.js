// Who hears of an alarm: the outputs and what each answers a test, and this browser.
import { offer } from "../command.js";
import { get, post } from "../net.js";
import { permission, setNews, wantsNews } from "../notify.js";
import { on, state } from "../state.js";
import { card, copy, h, replace, setText, toast, words } from "../ui.js";

const EXAMPLE = `output:
  - mqtt://broker.local
  - webhook:https://example.net/alarm`;

export function news(signal) {
  const rows = h("tbody", {});
  const table = h(
    "table",
    { class: "outputs" },
    h("caption", { class: "hidden" }, "Outputs"),
    h("thead", {}, h("tr", {}, ["Output", "State", "Test alarm"].map((text) => h("th", { scope: "col" }, text)))),
    rows,
  );
  const button = h("button", { type: "button", class: "primary" }, "Send a test alarm");
  const said = h("p", { role: "status", class: "quiet" });
  let answers = new Map();
  let isAsking = false;
  const { nodes, draw: drawButton } = offer(button, signal, () => (isAsking ? "Waiting for answers" : ""));
  const draw = () => {
    drawButton();
    replace(
      rows,
      ...state.outputs.map(({ name, status, reason }) =>
        h(
          "tr",
          {},
          h("td", { class: "name" }, name),
          h("td", {}, h("span", { class: `pill ${status === "ok" ? "good" : "invalid"}` }, status === "ok" ? "well" : "in trouble"), reason ? h("small", {}, ` ${reason}`) : null),
          h("td", { class: answers.get(name)?.startsWith("failed") ? "bad" : "" }, answers.get(name) ?? "–"),
        ),
      ),
    );
  };
  const load = async () => {
    try {
      state.outputs = (await get("/api/v1/status")).outputs;
    } catch {
      // The page says by itself that the connection is lost.
    }
    if (!signal.aborted) draw();
  };
  button.addEventListener("click", async () => {
    isAsking = true;
    drawButton();
    setText(said, "");
    try {
      const { outputs } = await post("/api/v1/test-alarm", {});
      answers = new Map(outputs.map(({ output, answer }) => [output, answer]));
      const failed = outputs.filter(({ answer }) => answer.startsWith("failed")).length;
      const taken = outputs.filter(({ answer }) => answer === "taken").length;
      const told = taken === outputs.length ? "Every output has it" : `${taken} of ${outputs.length} outputs have it`;
      setText(said, failed ? `${failed} of ${outputs.length} outputs failed.` : `${told}, marked as a test.`);
    } catch (error) {
      setText(said, "");
      toast(`No test: ${error.message}`, "bad");
    }
    isAsking = false;
    await load();
  });
  const timer = setInterval(load, 5000);
  signal.addEventListener("abort", () => clearInterval(timer));
  on("hello", load, signal);
  load();
  const lines = h("pre", { tabindex: "0", "aria-label": "Lines for config.yaml" }, EXAMPLE);
  return card(
    "Notifications",
    "who hears of an alarm",
    h("p", { class: "buttons" }, ...nodes),
    said,
    table,
    h("h3", {}, "In this browser ", h("small", {}, "while this page is open, also in the background")),
    browserNews(),
    h("h3", {}, "Elsewhere ", words(h("small", {}, "a phone, home automation, a mail: the configuration names them"), h("small", {}, "in config.yaml; docs/reference/outputs.md lists all kinds"))),
    h("div", { class: "exact" }, lines, h("p", { class: "buttons" }, h("button", { type: "button", onclick: () => copy(EXAMPLE) }, "Copy"))),
  );
}

function browserNews() {
  const button = h("button", { type: "button", "aria-pressed": String(wantsNews()) });
  const said = h("p", { class: "quiet", role: "status" });
  const draw = () => {
    const may = permission();
    button.disabled = may === "" || may === "denied";
    button.setAttribute("aria-pressed", String(wantsNews()));
    setText(button, wantsNews() ? "Notifications are on" : "Show notifications here");
    const why = {
      "": "This browser shows none for a page without TLS; open it at localhost or behind a TLS proxy.",
      denied: "This browser was told to show none for this page; its own settings allow them again.",
    };
    setText(said, why[may] ?? "");
  };
  button.addEventListener("click", async () => {
    await setNews(!wantsNews());
    draw();
  });
  draw();
  return h("div", {}, h("p", { class: "buttons" }, button), said);
}
