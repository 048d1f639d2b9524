// Commands to the daemon, from any page.
import { post } from "./net.js";
import { toast } from "./ui.js";

export async function command(name) {
  try {
    await post("/api/v1/command", { command: name });
  } catch (error) {
    toast(`Not done: ${error.message}`, "bad");
  }
}
