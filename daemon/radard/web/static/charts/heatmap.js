// Heat-maps on canvas: pictures by stream time, and the gait picture.
import { Chart, colour, themeVersion, tickText, ticks } from "./chart.js";
import { css, currentMap } from "./colour.js";
import { GOOD, MISSING } from "./pictures.js";
import { duration, fixed, hasDetails } from "../ui.js";

export const TITLES = {
  range: ["Where", "range"],
  velocity: ["How fast", "radial velocity"],
  doppler: ["Limbs", "micro-Doppler"],
  gait: ["Gait", "cadence"],
};

// What stands in a cell, for those who did not ask for details.
const LEVELS = [
  [191, "strong"],
  [110, "clear"],
  [1, "weak"],
  [0, "nothing"],
];
const PLACES = {
  range: (value) => `${fixed(value, 1)} m away`,
  velocity: speedText,
  doppler: speedText,
};

function speedText(value) {
  const speed = `${fixed(Math.abs(value), 1)} m/s`;
  return Math.abs(value) < 0.05 ? speed : `${speed} ${value > 0 ? "nearer" : "farther"}`;
}

const STALE_S = 2;

export class HeatMap extends Chart {
  constructor(host, name, pictures, options = {}) {
    super(host, { label: TITLES[name].join(", "), ...options });
    this.name = name;
    this.pictures = pictures;
    this.isRelative = options.isRelative ?? true;
    this.hasTime = options.hasTime ?? true;
    this.marks = [];
    this.shade = null;
    this.strip = document.createElement("canvas");
    this.drawnTo = -1;
    this.drawnVersion = -1;
    this.drawnTheme = -1;
  }

  setPictures(pictures) {
    this.pictures = pictures;
    this.drawnVersion = -1;
  }

  draw(view) {
    this.view = view;
    const c = this.begin(view);
    const { axes } = this.pictures;
    if (!axes) return;
    const picture = this.pictures.by.get(this.name);
    this.#paint(picture);
    this.#place(c, axes.column_s);
    const low = picture.first - picture.step / 2;
    const high = low + picture.n_rows * picture.step;
    this.low = low;
    this.high = high;
    const y = (value) => this.box.y + this.box.h * (1 - (value - low) / (high - low));
    if (low < 0 && high > 0) {
      c.globalAlpha = 0.35;
      c.fillStyle = colour("faint");
      c.fillRect(this.box.x, Math.round(y(0)), this.box.w, 1);
      c.globalAlpha = 1;
    }
    if (this.name === "velocity") this.#drawUnambiguous(c, y, axes.unambiguous_mps, high);
    this.#drawMarks(c, y);
    this.drawY(low, high, y, picture.unit);
    if (this.hasTime) this.drawTime(this.isRelative);
  }

  // New columns onto the strip, a canvas with one pixel for every cell that is kept.
  #paint(picture) {
    const { pictures, strip } = this;
    const isNew =
      this.drawnVersion !== pictures.version ||
      this.drawnTheme !== themeVersion() ||
      strip.width !== pictures.slots ||
      strip.height !== picture.n_rows;
    if (isNew) {
      strip.width = pictures.slots;
      strip.height = picture.n_rows;
      this.drawnTo = pictures.oldest - 1;
      this.drawnVersion = pictures.version;
      this.drawnTheme = themeVersion();
    }
    if (pictures.newest <= this.drawnTo) return;
    const from = Math.max(this.drawnTo + 1, pictures.oldest);
    const c = strip.getContext("2d");
    let slot = from;
    while (slot <= pictures.newest) {
      // As many columns as lie side by side on the strip.
      const at = slot % pictures.slots;
      const n = Math.min(pictures.newest - slot + 1, pictures.slots - at);
      c.putImageData(this.#columns(picture, slot, n), at, 0);
      slot += n;
    }
    this.drawnTo = pictures.newest;
  }

  #columns(picture, first, n) {
    const image = new ImageData(n, picture.n_rows);
    const pixels = new Uint32Array(image.data.buffer);
    const table = currentMap();
    const data = this.pictures.data.get(this.name);
    for (let k = 0; k < n; k += 1) {
      const at = (first + k) % this.pictures.slots;
      const how = this.pictures.state[at];
      if (how === MISSING) continue;
      for (let row = 0; row < picture.n_rows; row += 1) {
        const value = how === GOOD ? data[at * picture.n_rows + row] : 0;
        pixels[(picture.n_rows - 1 - row) * n + k] = table[value];
      }
    }
    return image;
  }

  #place(c, column_s) {
    const { slots, oldest, newest } = this.pictures;
    if (newest < 0) return;
    const { x, y, w, h } = this.box;
    c.save();
    c.beginPath();
    c.rect(x, y, w, h);
    c.clip();
    c.imageSmoothingEnabled = true;
    const first = Math.max(oldest, Math.floor(this.view.from_s / column_s) - 1);
    const last = Math.min(newest, Math.ceil(this.view.to_s / column_s) + 1);
    let slot = first;
    while (slot <= last) {
      const at = slot % slots;
      const n = Math.min(last - slot + 1, slots - at);
      const left = this.x((slot - 0.5) * column_s);
      const right = this.x((slot + n - 0.5) * column_s);
      c.drawImage(this.strip, at, 0, n, this.strip.height, left, y, right - left, h);
      slot += n;
    }
    if (this.shade) {
      c.fillStyle = colour("panel");
      c.globalAlpha = 0.55;
      const left = this.x(this.shade.from_s);
      const right = this.x(this.shade.to_s);
      c.fillRect(x, y, left - x, h);
      c.fillRect(right, y, x + w - right, h);
      c.globalAlpha = 1;
      c.fillStyle = colour("accent");
      c.fillRect(Math.round(left), y, 1, h);
      c.fillRect(Math.round(right) - 1, y, 1, h);
    }
    c.restore();
  }

  // Speeds between the dashed lines have no double.
  #drawUnambiguous(c, y, apart, high) {
    if (!apart || apart / 2 >= high) return;
    c.strokeStyle = colour("dim");
    c.setLineDash([4, 4]);
    c.lineWidth = 1;
    for (const value of [-apart / 2, apart / 2]) {
      c.beginPath();
      c.moveTo(this.box.x, y(value));
      c.lineTo(this.box.x + this.box.w, y(value));
      c.stroke();
    }
    c.setLineDash([]);
    const text = hasDetails() ? "unambiguous" : "sure between the lines";
    const width = c.measureText(text).width;
    c.globalAlpha = 0.8;
    c.fillStyle = colour("plot");
    c.fillRect(this.box.x + 4, y(apart / 2) - 15, width + 8, 14);
    c.globalAlpha = 1;
    c.fillStyle = colour("dim");
    c.textAlign = "left";
    c.textBaseline = "middle";
    c.fillText(text, this.box.x + 8, y(apart / 2) - 8);
  }

  #drawMarks(c, y) {
    const { x, y: top, w, h } = this.box;
    for (const mark of this.marks) {
      const px = this.x(mark.t_s);
      if (px < x - 4 || px > x + w + 4) continue;
      // A track that has left the swath is still followed a little: it waits at the edge.
      const py = Math.min(Math.max(y(mark.value), top), top + h);
      c.beginPath();
      c.arc(px, py, 3.5, 0, 2 * Math.PI);
      c.fillStyle = colour(mark.tone);
      c.strokeStyle = colour("panel");
      c.lineWidth = 1.5;
      c.fill();
      c.stroke();
    }
  }

  explain(share, height) {
    const { pictures } = this;
    if (!pictures.axes || this.low === undefined) return "";
    const picture = pictures.by.get(this.name);
    const t_s = this.view.from_s + share * (this.view.to_s - this.view.from_s);
    const slot = Math.round(t_s / pictures.axes.column_s);
    const row = Math.min(picture.n_rows - 1, Math.floor(height * picture.n_rows));
    const value = pictures.value(this.name, slot, row);
    if (value === null) return "";
    const place = picture.first + row * picture.step;
    if (!hasDetails()) {
      return `${PLACES[this.name](place)} · ${LEVELS.find(([least]) => value >= least)[1]}`;
    }
    const below = ((255 - value) / 255) * picture.span_db;
    const at = fixed(place, 2);
    const level = value === 0 ? `under −${picture.span_db} dB` : `${fixed(-below, 0)} dB`;
    return `${fixed(t_s, 1)} s · ${at} ${picture.unit} · ${level}`;
  }
}

// The cadence velocity diagram of the last two seconds.
export class GaitMap extends Chart {
  constructor(host, pictures, options = {}) {
    super(host, { label: TITLES.gait.join(", "), ...options });
    this.pictures = pictures;
    this.image = document.createElement("canvas");
  }

  // Of an empty room there is no gait: the last one stays, with its age.
  draw(isMoving) {
    const c = this.begin(isMoving);
    const { axes } = this.pictures;
    if (!axes) return;
    if (isMoving || this.pictures.version !== this.version) this.gait = isMoving ? this.pictures.gait : null;
    this.version = this.pictures.version;
    const { gait } = this;
    const picture = this.pictures.by.get("gait");
    this.picture = picture;
    this.high = axes.gait_step_hz * (gait ? gait.n : 15);
    const ago_s = gait ? (performance.now() - gait.atMs) / 1000 : 0;
    c.globalAlpha = ago_s > STALE_S ? 0.35 : 1;
    if (gait) this.#paint(c, gait);
    c.globalAlpha = 1;
    if (ago_s > STALE_S) {
      c.fillStyle = colour("ink");
      c.textAlign = "right";
      c.textBaseline = "top";
      c.fillText(`${duration(ago_s)} ago`, this.box.x + this.box.w - 6, this.box.y + 6);
    }
    const low = picture.first - picture.step / 2;
    const top = low + picture.n_rows * picture.step;
    this.drawY(low, top, (v) => this.box.y + this.box.h * (1 - (v - low) / (top - low)), picture.unit);
    const { found, step } = ticks(0, this.high, this.box.w / 48);
    c.fillStyle = colour("dim");
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const value of found) {
      const x = this.box.x + (value / this.high) * this.box.w;
      const text = `${tickText(value, step)} ${hasDetails() ? "Hz" : "/s"}`;
      const half = c.measureText(text).width / 2;
      c.fillRect(Math.round(x), this.box.y + this.box.h, 1, 3);
      c.fillText(text, Math.min(x, this.width - half - 1), this.box.y + this.box.h + 6);
    }
  }

  #paint(c, gait) {
    const { n, rows, values } = gait;
    this.image.width = n;
    this.image.height = rows;
    const image = new ImageData(n, rows);
    const pixels = new Uint32Array(image.data.buffer);
    const table = currentMap();
    for (let k = 0; k < n; k += 1) {
      for (let row = 0; row < rows; row += 1) {
        pixels[(rows - 1 - row) * n + k] = table[k === 0 ? 0 : values[k * rows + row]];
      }
    }
    this.image.getContext("2d").putImageData(image, 0, 0);
    const { x, y, w, h } = this.box;
    c.drawImage(this.image, 0, 0, n, rows, x, y, w, h);
  }

  explain(share, height) {
    if (!this.picture || !this.gait) return "";
    const { first, step, n_rows, unit } = this.picture;
    const often = fixed(share * this.high, 1);
    const speed = `${fixed(first + height * n_rows * step, 2)} ${unit}`;
    return hasDetails() ? `${often} Hz · ${speed}` : `${often} times a second · ${speed}`;
  }
}

// A small key: what dark and bright mean.
export function drawScale(canvas, span_db) {
  const c = canvas.getContext("2d");
  canvas.width = 96;
  canvas.height = 1;
  const table = currentMap();
  for (let i = 0; i < 96; i += 1) {
    c.fillStyle = css(table, Math.round((i / 95) * 255));
    c.fillRect(i, 0, 1, 1);
  }
  canvas.title = `from ${span_db} dB under the strongest of each moment to the strongest`;
}
