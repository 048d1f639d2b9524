// Colour maps that are even to the eye: lightness in equal steps in OKLab (Ottosson 2020),
// hue turning slowly. On a dark page what is strong is light, on a light page it is dark.

function fromOklch(lightness, chroma, hue) {
  const a = chroma * Math.cos((hue * Math.PI) / 180);
  const b = chroma * Math.sin((hue * Math.PI) / 180);
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  return [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ];
}

function isInGamut(rgb) {
  return rgb.every((x) => x >= -1e-4 && x <= 1 + 1e-4);
}

function toByte(x) {
  const c = Math.min(1, Math.max(0, x));
  return Math.round(255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055));
}

// Less chroma until the screen can show it: lightness is what must hold.
function shown(lightness, chroma, hue) {
  let c = chroma;
  let rgb = fromOklch(lightness, c, hue);
  while (!isInGamut(rgb) && c > 0) {
    c -= 0.004;
    rgb = fromOklch(lightness, c, hue);
  }
  return rgb.map(toByte);
}

export function colourMap(isDark) {
  const table = new Uint32Array(256);
  for (let i = 0; i < 256; i += 1) {
    const x = i / 255;
    const lightness = isDark ? 0.19 + 0.77 * x : 0.985 - 0.72 * x;
    const hue = isDark ? 255 - 165 * x : 215 + 68 * x;
    const most = isDark ? 0.15 : 0.13;
    const chroma = (isDark ? 0.03 : 0.003) + most * Math.sin(Math.PI * x * (isDark ? 0.96 : 0.75));
    const [r, g, b] = shown(lightness, chroma, isDark && x > 0.5 ? hue - 30 * (x - 0.5) : hue);
    table[i] = (255 << 24) | (b << 16) | (g << 8) | r;
  }
  return table;
}

export function css(table, i) {
  const c = table[i];
  return `rgb(${c & 255} ${(c >> 8) & 255} ${(c >> 16) & 255})`;
}

const cache = new Map();

export function currentMap() {
  const isDark = isDarkNow();
  if (!cache.has(isDark)) cache.set(isDark, colourMap(isDark));
  return cache.get(isDark);
}

export function isDarkNow() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}
