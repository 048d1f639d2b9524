// Lines over stream time, made of decisions: probabilities, gate power, evidence.
import { Chart, colour } from "./chart.js";
import { fixed, hasDetails } from "../ui.js";

export class LinePlot extends Chart {
  // series: [{key, label, tone, width, dash, isStep}], read from decisions by key.
  // plain: {unit, tick, tell} for those who did not ask for details: the unit, a value's text on
  // the axis, and a decision's text in the tooltip.
  constructor(host, { series, low, high, unit, label, plain, limits = () => [], ...options }) {
    super(host, { label, ...options });
    this.plain = plain;
    this.series = series;
    this.range = { low, high };
    this.unit = unit;
    this.limits = limits;
    this.isRelative = options.isRelative ?? true;
    this.decisions = [];
    this.cursor = null;
  }

  draw(view, decisions) {
    this.view = view;
    const c = this.begin(view, decisions);
    const span = view.to_s - view.from_s;
    this.decisions = decisions.filter((d) => d.t_s > view.from_s - 0.2 * span && d.t_s < view.to_s + 2);
    const { low, high } = this.#bounds();
    this.low = low;
    this.high = high;
    const { x, y: top, w, h } = this.box;
    const y = (value) => top + h * (1 - (value - low) / (high - low));
    c.save();
    c.beginPath();
    c.rect(x, top, w, h);
    c.clip();
    for (const line of this.series) this.#drawLine(c, y, line);
    for (const limit of this.limits()) this.#drawLimit(c, y, limit);
    if (this.cursor !== null) {
      c.fillStyle = colour("accent");
      c.fillRect(Math.round(this.x(this.cursor)), top, 1, h);
    }
    c.restore();
    if (hasDetails()) this.drawY(low, high, y, this.unit);
    else this.drawY(low, high, y, this.plain.unit, this.plain.tick);
    this.drawTime(this.isRelative);
  }

  #bounds() {
    let { low, high } = this.range;
    if (low !== undefined && high !== undefined) return { low, high };
    const values = this.decisions.flatMap((d) => this.series.map((s) => d[s.key])).filter(Number.isFinite);
    if (!values.length) return { low: low ?? -60, high: high ?? 0 };
    low = Math.floor((Math.min(...values) - 2) / 5) * 5;
    high = Math.ceil((Math.max(...values) + 2) / 5) * 5;
    return { low, high };
  }

  #drawLimit(c, y, { value, text, tone }) {
    c.strokeStyle = colour(tone ?? "dim");
    c.fillStyle = colour(tone ?? "dim");
    c.setLineDash([4, 4]);
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(this.box.x, y(value));
    c.lineTo(this.box.x + this.box.w, y(value));
    c.stroke();
    c.setLineDash([]);
    // On a ground of its own: lines run through here.
    c.textAlign = "left";
    c.textBaseline = "middle";
    const width = c.measureText(text).width;
    c.fillStyle = colour("plot");
    c.fillRect(this.box.x + 8, y(value) - 8, width + 8, 16);
    c.fillStyle = colour(tone ?? "dim");
    c.fillText(text, this.box.x + 12, y(value));
  }

  #drawLine(c, y, { key, tone, width = 2, dash = [], hasDots = true }) {
    c.strokeStyle = colour(tone);
    c.fillStyle = colour(tone);
    c.lineWidth = width;
    c.lineJoin = "round";
    c.setLineDash(dash);
    let isOn = false;
    c.beginPath();
    for (const d of this.decisions) {
      const value = d[key];
      if (value === null || value === undefined) {
        isOn = false;
        continue;
      }
      if (isOn) c.lineTo(this.x(d.t_s), y(value));
      else c.moveTo(this.x(d.t_s), y(value));
      isOn = true;
    }
    c.stroke();
    c.setLineDash([]);
    if (!hasDots) return;
    for (const d of this.decisions) {
      if (d[key] === null || d[key] === undefined) continue;
      c.beginPath();
      c.arc(this.x(d.t_s), y(d[key]), width + 0.6, 0, 2 * Math.PI);
      c.fill();
    }
  }

  explain(share) {
    const t_s = this.view.from_s + share * (this.view.to_s - this.view.from_s);
    let near = null;
    for (const d of this.decisions) {
      if (!near || Math.abs(d.t_s - t_s) < Math.abs(near.t_s - t_s)) near = d;
    }
    if (!near || Math.abs(near.t_s - t_s) > 1.5) return "";
    if (!hasDetails()) return this.plain.tell(near);
    const parts = this.series
      .filter((s) => near[s.key] !== null && near[s.key] !== undefined)
      .map((s) => `${s.label} ${fixed(near[s.key], s.digits ?? 2)}`);
    return parts.length ? `${fixed(near.t_s, 1)} s · ${parts.join(" · ")}` : "";
  }
}
