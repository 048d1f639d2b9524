// What all charts share: a canvas that fits its place, axes with units, and a tooltip.
import { h } from "../ui.js";

export const MARGIN = { left: 52, right: 12, top: 6, bottom: 20 };

export function niceStep(span, most) {
  const raw = span / Math.max(1, most);
  const power = 10 ** Math.floor(Math.log10(raw));
  return [1, 2, 2.5, 5, 10].map((m) => m * power).find((step) => step >= raw * 0.999);
}

export function ticks(low, high, most) {
  const step = niceStep(high - low, most);
  const found = [];
  for (let k = Math.ceil(low / step - 1e-9); k * step <= high + step * 1e-9; k += 1) found.push(k * step);
  return { step, found };
}

export function tickText(value, step) {
  const digits = Math.max(0, Math.ceil(-Math.log10(step) - 1e-9));
  const isQuarter = Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6;
  return (value + 0).toFixed(digits + (isQuarter ? 1 : 0)).replace("-", "−");
}

const styles = { version: 0, values: null };

export function themeChanged() {
  styles.values = null;
  styles.version += 1;
}

export function themeVersion() {
  return styles.version;
}

export function colour(name) {
  if (!styles.values) {
    const computed = getComputedStyle(document.documentElement);
    styles.values = new Map();
    for (const key of ["ink", "dim", "faint", "line", "panel", "plot", "human", "pet", "other", "accent", "alarm"]) {
      styles.values.set(key, computed.getPropertyValue(`--${key}`).trim());
    }
  }
  return styles.values.get(name);
}

export class Chart {
  constructor(host, { label, height = 140, margin = {} }) {
    this.margin = { ...MARGIN, ...margin };
    this.canvas = h("canvas", { role: "img", "aria-label": label, tabindex: "-1" });
    this.tip = h("div", { class: "tip", hidden: true });
    this.host = h("div", { class: "chart" }, this.canvas, this.tip);
    this.host.style.height = `${height}px`;
    host.append(this.host);
    this.context = this.canvas.getContext("2d");
    this.view = { from_s: -30, to_s: 0 };
    this.drawn = null;
    this.observer = new ResizeObserver(([{ contentRect }]) => {
      this.size = contentRect;
      // A canvas that changes its size is empty.
      if (this.drawn) this.draw(...this.drawn);
    });
    this.observer.observe(this.host);
    // What is scrolled away needs no drawing while it moves on.
    this.isInSight = false;
    this.sight = new IntersectionObserver(([seen]) => {
      this.isInSight = seen.isIntersecting;
    });
    this.sight.observe(this.host);
    this.canvas.addEventListener("pointermove", (event) => this.#hover(event));
    this.canvas.addEventListener("pointerleave", () => {
      this.tip.hidden = true;
    });
  }

  close() {
    this.observer.disconnect();
    this.sight.disconnect();
  }

  describe(text) {
    if (this.canvas.getAttribute("aria-label") !== text) this.canvas.setAttribute("aria-label", text);
  }

  // Before it draws, and not before: six canvases at once would hold up the first picture of the page.
  #fit() {
    const { width, height } = this.size ?? this.host.getBoundingClientRect();
    this.ratio = Math.min(2, devicePixelRatio || 1);
    this.width = Math.max(60, width);
    this.height = Math.max(40, height);
    const [w, h] = [this.width, this.height].map((length) => Math.round(length * this.ratio));
    if (this.canvas.width !== w) this.canvas.width = w;
    if (this.canvas.height !== h) this.canvas.height = h;
  }

  get box() {
    const { left, right, top, bottom } = this.margin;
    return { x: left, y: top, w: this.width - left - right, h: this.height - top - bottom };
  }

  x(t_s) {
    const { from_s, to_s } = this.view;
    return this.box.x + ((t_s - from_s) / (to_s - from_s)) * this.box.w;
  }

  begin(...drawn) {
    this.#fit();
    this.drawn = drawn;
    const c = this.context;
    c.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    c.clearRect(0, 0, this.width, this.height);
    c.font = "11px system-ui, sans-serif";
    c.fillStyle = colour("plot");
    const { x, y, w, h: height } = this.box;
    c.fillRect(x, y, w, height);
    return c;
  }

  // Values on the left: ticks that are never closer than a line of text.
  drawY(low, high, y, unit, text = tickText) {
    const c = this.context;
    const { found, step } = ticks(low, high, Math.max(2, this.box.h / 26));
    c.fillStyle = colour("dim");
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const value of found) {
      c.fillText(text(value, step), this.box.x - 6, y(value));
      c.fillRect(this.box.x - 3, Math.round(y(value)), 3, 1);
    }
    c.save();
    c.translate(8, this.box.y + this.box.h / 2);
    c.rotate(-Math.PI / 2);
    c.textAlign = "center";
    c.fillText(unit, 0, 0);
    c.restore();
  }

  // Stream time below: seconds before now while it runs, the clock of a clip otherwise.
  drawTime(isRelative) {
    const c = this.context;
    const { from_s, to_s } = this.view;
    const zero = isRelative ? to_s : 0;
    const { found, step } = ticks(from_s - zero, to_s - zero, this.box.w / 64);
    c.fillStyle = colour("dim");
    c.textAlign = "center";
    c.textBaseline = "top";
    const y = this.box.y + this.box.h;
    for (const value of found) {
      const x = this.x(value + zero);
      c.fillRect(Math.round(x), y, 1, 3);
      const isNow = isRelative && Math.abs(value) < 1e-9;
      const text = isNow ? "now" : `${tickText(value, step)} s`;
      const half = c.measureText(text).width / 2;
      c.fillText(text, Math.min(Math.max(x, half), this.width - half - 1), y + 6);
    }
  }

  #hover(event) {
    const bounds = this.canvas.getBoundingClientRect();
    const px = event.clientX - bounds.left;
    const py = event.clientY - bounds.top;
    const { x, y, w, h: height } = this.box;
    const isIn = px >= x && px <= x + w && py >= y && py <= y + height;
    const text = isIn ? this.explain((px - x) / w, 1 - (py - y) / height) : "";
    this.tip.hidden = !text;
    if (!text) return;
    this.tip.textContent = text;
    this.tip.style.left = `${Math.min(px + 12, this.width - this.tip.offsetWidth - 4)}px`;
    this.tip.style.top = `${Math.max(2, py - 30)}px`;
  }

  // What the tooltip says at a place, both from 0 to 1.
  explain() {
    return "";
  }
}
