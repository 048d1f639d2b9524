// The two plots of decisions that several pages show.
import { limit } from "../state.js";
import { fixed, hasDetails, percent, timesText, verdict } from "../ui.js";
import { LinePlot } from "./plot.js";

const FUSED = [
  { key: "fused_p_pet", label: "pet", tone: "pet" },
  { key: "fused_p_human", label: "person", tone: "human" },
];
const OF_WINDOW = [
  { key: "p_pet", label: "pet, now", tone: "pet", width: 1.2, dash: [2, 3], hasDots: false },
  { key: "p_human", label: "person, now", tone: "human", width: 1.2, dash: [2, 3], hasDots: false },
];

export function chancesPlot(host, { hasWindows = false, ...options }) {
  return new LinePlot(host, {
    low: 0,
    high: 1,
    unit: "probability",
    plain: {
      unit: "how sure",
      tick: percent,
      tell: (d) => {
        if (d.fused_p_human === null) return verdict(d)[0];
        return `person ${percent(d.fused_p_human)} · pet ${percent(d.fused_p_pet)}`;
      },
    },
    series: hasWindows ? [...OF_WINDOW, ...FUSED] : FUSED,
    limits: () => [{ value: limit(), text: limitText(), tone: "pet" }],
    ...options,
  });
}

function limitText() {
  const share = hasDetails() ? fixed(limit(), 2) : percent(limit());
  return `pet above ${share}: no alarm`;
}

export function powerPlot(host, options) {
  return new LinePlot(host, {
    unit: "dB",
    // What it is called for those who listen; a scale of its own would say nothing to a person.
    plain: {
      unit: "strength",
      tick: () => "",
      tell: (d) => {
        if (d.power_db === null) return verdict(d)[0];
        const counts = d.gate === "open" ? "counts" : "too weak to count";
        return `${timesText(d)} the room's noise · ${counts}`;
      },
    },
    series: [
      { key: "threshold_db", label: "threshold", tone: "dim", width: 1.2, dash: [4, 4], hasDots: false, digits: 1 },
      { key: "noise_floor_db", label: "floor", tone: "faint", width: 1, hasDots: false, digits: 1 },
      { key: "power_db", label: "power", tone: "accent", digits: 1 },
    ],
    ...options,
  });
}
