// The line to the daemon: a WebSocket that comes back by itself, and requests.
import { pictures, state, take, tell } from "./state.js";

const FIRST_RETRY_MS = 500;
const LONGEST_RETRY_MS = 4000;
const SILENT_MS = 12000;
const DRAWN_MS = 250;

// A proxy may serve all of this below a path; one of several sensors has its pages, and all it asks
// for, below a path of its own.
const HOME = location.pathname.replace(/\/[^/]*$/, "");
const ROOT = HOME.replace(/\/sensor\/[\w-]+$/, "");

export const at = (path) => `${HOME}${path}`;
export const below = (path) => `${ROOT}${path}`;

let socket = null;
let retryMs = FIRST_RETRY_MS;
let wantsPictures = false;
let nTaken = 0;
let drawnTimer = null;
let heardMs = 0;

export function connect() {
  const scheme = location.protocol === "https:" ? "wss" : "ws";
  socket = new WebSocket(`${scheme}://${location.host}${at("/ws")}`);
  socket.binaryType = "arraybuffer";
  heardMs = performance.now();
  socket.addEventListener("open", () => {
    retryMs = FIRST_RETRY_MS;
    nTaken = 0;
    setConnection("open");
    say({ pictures: wantsPictures });
  });
  socket.addEventListener("message", (event) => {
    heardMs = performance.now();
    if (typeof event.data === "string") {
      take(JSON.parse(event.data));
      return;
    }
    nTaken += 1;
    pictures.take(event.data);
    tellDrawn();
  });
  socket.addEventListener("close", lost);
}

export function watchPictures(isWanted) {
  if (isWanted === wantsPictures) return;
  wantsPictures = isWanted;
  if (isWanted) pictures.clear();
  say({ pictures: isWanted });
}

// Not for every picture: a minute of them comes at once to a page that opens, and the daemon
// takes only so many messages a second.
function tellDrawn() {
  drawnTimer ??= setTimeout(() => {
    drawnTimer = null;
    say({ drawn: nTaken });
  }, DRAWN_MS);
}

function say(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

async function lost() {
  socket = null;
  setConnection("lost");
  setTimeout(connect, retryMs * (0.75 + 0.5 * Math.random()));
  retryMs = Math.min(2 * retryMs, LONGEST_RETRY_MS);
  try {
    // A session that has run out looks like a lost line; the page then asks for the token.
    const answer = await fetch(at("/api/v1/status"));
    if (answer.status === 401) location.reload();
  } catch {
    // The daemon is away: the next attempt will tell.
  }
}

function setConnection(how) {
  state.connection = how;
  tell("now");
}

// A line that is dead without saying so: decisions come every second.
setInterval(() => {
  const isPaused = state.playback && !state.playback.is_playing;
  const isQuiet = performance.now() - heardMs > SILENT_MS;
  if (socket?.readyState === WebSocket.OPEN && isQuiet && !isPaused && state.state !== "offline") {
    heardMs = performance.now();
    fetch(below("/healthz")).catch(() => socket?.close());
  }
}, 2000);

addEventListener("online", () => {
  retryMs = FIRST_RETRY_MS;
});

export async function get(path) {
  return answered(await fetch(at(path)));
}

export async function post(path, body) {
  return answered(
    await fetch(at(path), {
      method: "POST",
      headers: { "Content-Type": "application/json", "X-Radard": "1" },
      body: JSON.stringify(body),
    }),
  );
}

async function answered(answer) {
  if (answer.status === 401) location.reload();
  const body = await answer.json().catch(() => ({ error: answer.statusText }));
  if (!answer.ok) throw new Error(body.error ?? answer.statusText);
  return body;
}
