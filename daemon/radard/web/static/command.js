// Commands to the daemon, from any page.
import { post } from "./net.js";
import { hindrance, on } from "./state.js";
import { h, setText, toast } from "./ui.js";

let nOffers = 0;

// A button that can be pressed while `reason` returns nothing; what it returns stands beside it.
// Returns both, and draws them again whenever the panel or the line changes. Buttons that change
// nothing are for those who may only look, too.
export function offer(button, signal, reason = () => "", { isForAll = false } = {}) {
  nOffers += 1;
  const note = h("small", { id: `why-not-${nOffers}`, class: "whynot" });
  button.setAttribute("aria-describedby", note.id);
  const draw = () => {
    const why = hindrance(isForAll) || reason();
    button.disabled = Boolean(why);
    setText(note, why);
  };
  on("now", draw, signal);
  draw();
  return { nodes: [button, note], draw };
}

export async function command(name) {
  try {
    await post("/api/v1/command", { command: name });
  } catch (error) {
    toast(`Not done: ${error.message}`, "bad");
  }
}
