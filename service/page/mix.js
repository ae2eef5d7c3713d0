// What a mix is, in numbers: the same as pipeline/mixes/mix.py. Matrices are arrays of nine, by rows.

const XYZ_TO_SRGB = [
  3.240969941904523, -1.537383177570095, -0.498610760293003, -0.969243636280888, 1.875967501507721,
  0.041555057407176, 0.055630079696994, -0.203976958888977, 1.056971514242879,
];
const BRADFORD = [0.8951, 0.2664, -0.1614, -0.7502, 1.7135, 0.0367, 0.0389, -0.0685, 1.0296];
const LEAST_CONE = 0.02;
const NOWHERE = 1e-12;
export const TINT_PER_DUV = -3000;
export const KELVIN = [1000, 15000];

/** The settings of a lamp that is left alone. */
export function untouched() {
  return { on: true, ev: 0, neutral: false, temperature_k: null, tint: 0, rgb: [1, 1, 1] };
}

/** Matrix of a lamp's layer to linear sRGB; basis: `mix` of the manifest. */
export function lampMatrix(basis, index, settings) {
  if (!settings.on) return new Array(9).fill(0);
  const lamp = basis.lamps[index];
  const neutral = settings.neutral || (settings.temperature_k !== null && !adapts(lamp.white));
  let shown = (neutral ? lamp.neutral_to_xyz : basis.to_xyz).flat();
  if (settings.temperature_k !== null) {
    const wanted = whiteOf(settings.temperature_k, settings.tint / TINT_PER_DUV);
    const change = neutral ? adaptation(basis.neutral, wanted) : adaptation(lamp.white, asShown(wanted, lamp));
    shown = times(change, shown);
  }
  const scale = 2 ** settings.ev;
  return times(XYZ_TO_SRGB, shown).map((value, place) => scale * settings.rgb[Math.floor(place / 3)] * value);
}

/** White for a wanted one: a lamp's own stays as the photograph shows it, others are exact. */
function asShown(wanted, lamp) {
  const own = lamp.own_white ?? lamp.white;
  const off = lamp.white.map((value, place) => value - own[place]);
  const away = wanted.map((value, place) => value - own[place]);
  const share = Math.exp(-squares(away) / Math.max(squares(off), NOWHERE));
  return wanted.map((value, place) => value + share * off[place]);
}

/** CIE XYZ, Y = 1, of the light of a colour temperature and Duv (Krystek 1985). */
export function whiteOf(kelvin, duv) {
  const before = planckian(0.999 * kelvin);
  const after = planckian(1.001 * kelvin);
  const across = [after[0] - before[0], after[1] - before[1]];
  const length = Math.hypot(...across);
  const [u, v] = planckian(kelvin);
  const x = u + (duv * across[1]) / length;
  const y = v - (duv * across[0]) / length;
  return [(1.5 * x) / y, 1, (4 - x - 10 * y) / (2 * y)];
}

/** Linear red, green and blue of "#rrggbb", the largest 1: a gel takes light away. */
export function gelOf(hex) {
  const linear = [1, 3, 5].map((place) => {
    const code = parseInt(hex.slice(place, place + 2), 16) / 255;
    return code <= 0.04045 ? code / 12.92 : ((code + 0.055) / 1.055) ** 2.4;
  });
  const most = Math.max(...linear, 1e-9);
  return linear.map((value) => value / most);
}

/** "#rrggbb" of a gel. */
export function hexOf(rgb) {
  const most = Math.max(...rgb, 1e-9);
  const codes = rgb.map((value) => {
    const light = value / most;
    const code = light <= 0.0031308 ? 12.92 * light : 1.055 * light ** (1 / 2.4) - 0.055;
    return Math.round(255 * code).toString(16).padStart(2, "0");
  });
  return `#${codes.join("")}`;
}

/** Read a preset; throws an Error with a sentence where it is none for so many lamps. */
export function readPreset(text, count) {
  let preset;
  try {
    preset = JSON.parse(text);
  } catch {
    throw new Error("The file is not a preset: it is not JSON.");
  }
  const lamps = preset?.lamps;
  if (!Array.isArray(lamps)) throw new Error("The file is not a preset: it has no list of lamps.");
  const other = Object.keys(preset).find((name) => name !== "lamps");
  if (other !== undefined) throw new Error(`The preset has ${JSON.stringify(other.slice(0, 40))} beside its lamps, which is not known.`);
  if (lamps.length !== count) {
    throw new Error(`The preset is one for ${lamps.length} ${lamps.length === 1 ? "lamp" : "lamps"}, and this photograph has ${count}.`);
  }
  return lamps.map((lamp) => {
    const read = { ...untouched(), ...lamp };
    const right =
      Object.prototype.toString.call(lamp) === "[object Object]" && // neither null nor a list
      Object.keys(read).length === 6 &&
      [read.on, read.neutral].every((flag) => typeof flag === "boolean") &&
      within(read.ev, -10, 10) &&
      within(read.tint, -150, 150) &&
      (read.temperature_k === null || within(read.temperature_k, ...KELVIN)) &&
      Array.isArray(read.rgb) &&
      read.rgb.length === 3 &&
      read.rgb.every((value) => within(value, 0, 100));
    if (!right) throw new Error("The preset has a setting that is unknown or out of its range.");
    if (read.tint !== 0 && read.temperature_k === null) throw new Error("The preset has a tint without a temperature.");
    return read;
  });
}

function within(value, low, high) {
  return typeof value === "number" && value >= low && value <= high;
}

function planckian(t) {
  return [
    (0.860117757 + 1.54118254e-4 * t + 1.28641212e-7 * t * t) / (1 + 8.42420235e-4 * t + 7.08145163e-7 * t * t),
    (0.317398726 + 4.22806245e-5 * t + 4.20481691e-8 * t * t) / (1 - 2.89741816e-5 * t + 1.61456053e-7 * t * t),
  ];
}

/** Bradford adaptation from one white to another. */
function adaptation(white, other) {
  const cones = apply(BRADFORD, white);
  const wanted = apply(BRADFORD, other);
  const least = LEAST_CONE * Math.max(...cones);
  const gains = wanted.map((value, index) => Math.max(value, 0) / Math.max(cones[index], least));
  const scaled = BRADFORD.map((value, place) => gains[Math.floor(place / 3)] * value);
  return times(inverse(BRADFORD), scaled);
}

/** Whether there is a white to adapt from: one of nearly one wavelength lacks a cone's light. */
function adapts(white) {
  const cones = apply(BRADFORD, white);
  return Math.min(...cones) > LEAST_CONE * Math.max(...cones);
}

function apply(m, v) {
  return [0, 3, 6].map((row) => m[row] * v[0] + m[row + 1] * v[1] + m[row + 2] * v[2]);
}

function squares(v) {
  return v.reduce((sum, value) => sum + value * value, 0);
}

function times(a, b) {
  return a.map((_, place) => {
    const row = 3 * Math.floor(place / 3);
    const column = place % 3;
    return a[row] * b[column] + a[row + 1] * b[column + 3] + a[row + 2] * b[column + 6];
  });
}

function inverse([a, b, c, d, e, f, g, i, j]) {
  const A = e * j - f * i;
  const B = f * g - d * j;
  const C = d * i - e * g;
  const whole = a * A + b * B + c * C;
  return [A, c * i - b * j, b * f - c * e, B, a * j - c * g, c * d - a * f, C, b * g - a * i, a * e - b * d].map(
    (value) => value / whole,
  );
}
