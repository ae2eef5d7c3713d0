// The sum of layers drawn without a graphics card, where that is quicker than WebGL by software.
//
// What a view shows of each layer is looked up once; while a lamp is changed only its own light is
// added anew to that of the others, and the tone curve is a table.

import { widened } from "./exr.js";

const STEPS = 16384; // of the tone curve: the darkest code value has six of them
const WHITE = [0.2126390058715103, 0.7151686787677559, 0.0721923153607337];
const STRIPES = [255, 64, 191];

export class Processor {
  /** context: 2d of the canvas; preview: of readExr, of so many lamps. */
  constructor(context, preview, lamps) {
    this._context = context;
    this._lamps = lamps;
    this._levels = [levelOf(preview, lamps)];
    this._detail = null;
    this._seen = null; // what the view shows of the layers, and what was made of it
  }

  /** Draw a view; gives whether that is as sharp as it can be. */
  draw(view) {
    this._look(view);
    const { left, top, columns, rows, picture, codes, halves } = this._seen;
    this._context.fillStyle = `rgb(${view.around.join(" ")})`;
    this._context.fillRect(0, 0, view.width, view.height);
    if (!columns || !rows) return true;
    this._sum(view.now);
    if (view.marked) markFilled(codes, this._seen);
    const split = Math.min(columns, Math.max(0, Math.round(view.split) - left));
    if (split > 0) this._showBefore(view.before, split);
    this._context.putImageData(picture, left, top);
    this._context.fillStyle = "#fff";
    if (view.split > 0) this._context.fillRect(Math.round(view.split) - 1, 0, 2, view.height);
    return !halves;
  }

  /** Show a part in full size over the preview; null takes it away. part: place and size in pixels of the preview. */
  showDetail(part) {
    this._detail = part && { part, level: levelOf(part.picture, this._lamps) };
    this._seen = null;
  }

  /** Look the layers up, unless that was done for the same view. While it moves, without smoothing. */
  _look(view) {
    const { width, height, corner, scale, level, detailed } = view;
    const place = [width, height, ...corner, scale, level, detailed].join();
    if (this._seen?.place === place && (view.moving || !this._seen.halves)) return;
    const preview = this._level(level);
    const area = areaOf(view, preview, corner, scale);
    const seen = emptied(area, this._lamps, this._context);
    sample(seen, preview, corner, scale, view.smooth && !view.moving);
    let halves = view.smooth;
    if (this._detail && detailed) {
      const { part, level: found } = this._detail;
      const from = corner.map((side, axis) => side + scale * part.corner[axis]);
      const full = scale * part.step;
      const smooth = full < 2 && full !== 1; // also where the preview is not
      sample(seen, found, from, full, smooth && !view.moving);
      halves ||= smooth;
    }
    this._seen = { ...seen, place, halves: halves && view.moving, others: "", old: "" };
  }

  /** Make the codes of the picture, from the lamp that was changed and the sum of the others. */
  _sum(now) {
    const seen = this._seen;
    const changed = now.findIndex((matrix, lamp) => String(matrix) !== seen.now?.[lamp]);
    const lamp = changed < 0 ? seen.lamp ?? 0 : changed;
    const others = now.map((matrix, index) => (index === lamp ? "" : String(matrix))).join(";") + lamp;
    if (seen.others !== others) {
      seen.base.fill(0);
      now.forEach((matrix, index) => index !== lamp && add(seen.base, seen.layers[index], matrix));
    }
    Object.assign(seen, { others, lamp, now: now.map(String) });
    encode(seen.codes, seen.base, seen.layers[lamp], now[lamp]);
  }

  /** Put the photograph as it was to the left of the split. */
  _showBefore(before, split) {
    const seen = this._seen;
    const wanted = String(before);
    if (seen.old !== wanted) {
      seen.before ??= new Uint32Array(seen.codes.length);
      const base = new Float32Array(seen.base.length);
      before.forEach((matrix, lamp) => lamp && add(base, seen.layers[lamp], matrix));
      encode(seen.before, base, seen.layers[0], before[0]);
      seen.old = wanted;
    }
    for (let start = 0; start < seen.codes.length; start += seen.columns) {
      seen.codes.set(seen.before.subarray(start, start + split), start);
    }
  }

  _level(number) {
    while (this._levels.length <= number) this._levels.push(halved(this._levels.at(-1)));
    return this._levels[number];
  }
}

/** Layers by pixel, red, green and blue together, and the confidence. */
function levelOf({ width, height, channels }, lamps) {
  const layers = Array.from({ length: lamps }, (_, lamp) => {
    const all = new Float32Array(3 * width * height);
    ["R", "G", "B"].forEach((letter, offset) => {
      const plane = widened(channels.get(`lamp${lamp + 1}.${letter}`));
      for (let pixel = 0, place = offset; pixel < plane.length; pixel++, place += 3) all[place] = plane[pixel];
    });
    return all;
  });
  const sure = channels.get("Y");
  return { width, height, whole: [width, height], layers, sure: sure ? widened(sure) : null };
}

/** The means of squares of four pixels. */
function halved({ width, height, whole, layers, sure }) {
  const size = [Math.max(1, width >> 1), Math.max(1, height >> 1)];
  const mean = (values, channels) => {
    const all = new Float32Array(channels * size[0] * size[1]);
    const right = width > 1 ? channels : 0;
    const below = height > 1 ? channels * width : 0;
    for (let y = 0, place = 0; y < size[1]; y++) {
      for (let x = 0; x < size[0]; x++) {
        for (let k = 0, from = channels * (2 * y * width + 2 * x); k < channels; k++, from++) {
          all[place++] = (values[from] + values[from + right] + values[from + below] + values[from + right + below]) / 4;
        }
      }
    }
    return all;
  };
  return { width: size[0], height: size[1], whole, layers: layers.map((one) => mean(one, 3)), sure: sure && mean(sure, 1) };
}

/** The pixels of the canvas that show a picture. */
function areaOf(view, { whole }, corner, scale) {
  const [left, top] = corner.map((side) => Math.max(0, Math.ceil(side - 0.5)));
  const ends = [view.width, view.height].map((side, axis) => Math.min(side, Math.ceil(corner[axis] + scale * whole[axis] - 0.5)));
  return { left, top, columns: Math.max(0, ends[0] - left), rows: Math.max(0, ends[1] - top) };
}

function emptied(area, lamps, context) {
  const pixels = area.columns * area.rows;
  const picture = pixels ? context.createImageData(area.columns, area.rows) : null;
  return {
    ...area,
    picture,
    codes: new Uint32Array(picture?.data.buffer ?? 0),
    base: new Float32Array(3 * pixels),
    layers: Array.from({ length: lamps }, () => new Float32Array(3 * pixels)),
    sure: new Float32Array(pixels).fill(1),
  };
}

/** Look a level up at every pixel of the canvas that it covers. */
function sample(seen, level, corner, scale, smooth) {
  const x = lookup(seen.left, seen.columns, corner[0], scale, level.width, level.whole[0], smooth);
  const y = lookup(seen.top, seen.rows, corner[1], scale, level.height, level.whole[1], smooth);
  seen.layers.forEach((layer, lamp) => take(layer, level.layers[lamp], level.width, x, y, 3));
  if (level.sure) take(seen.sure, level.sure, level.width, x, y, 1);
}

/** For each pixel along an axis the first of two neighbours, the second and its weight; −1: outside. */
function lookup(start, count, corner, scale, size, whole, smooth) {
  const first = new Int32Array(count);
  const second = new Int32Array(count);
  const weight = new Float32Array(count);
  for (let index = 0; index < count; index++) {
    const point = (start + index + 0.5 - corner) / scale / whole;
    const place = Math.min(size - 1, Math.max(0, smooth ? point * size - 0.5 : Math.floor(point * size)));
    first[index] = point < 0 || point >= 1 ? -1 : Math.floor(place);
    second[index] = Math.min(size - 1, Math.floor(place) + 1);
    weight[index] = place - Math.floor(place);
  }
  return { first, second, weight };
}

function take(to, from, width, x, y, channels) {
  const columns = x.first.length;
  for (let row = 0, place = 0; row < y.first.length; row++) {
    if (y.first[row] < 0) {
      place += channels * columns;
      continue;
    }
    const above = channels * width * y.first[row];
    const below = channels * width * y.second[row];
    const down = y.weight[row];
    for (let column = 0; column < columns; column++, place += channels) {
      if (x.first[column] < 0) continue;
      const left = channels * x.first[column];
      const right = channels * x.second[column];
      const across = x.weight[column];
      for (let k = 0; k < channels; k++) {
        const upper = from[above + left + k];
        if (across === 0 && down === 0) {
          to[place + k] = upper;
          continue;
        }
        const lower = from[below + left + k];
        const high = upper + across * (from[above + right + k] - upper);
        to[place + k] = high + down * (lower + across * (from[below + right + k] - lower) - high);
      }
    }
  }
}

/** Add a layer through its matrix. */
function add(sum, layer, [a, b, c, d, e, f, g, h, i]) {
  for (let place = 0; place < sum.length; place += 3) {
    const red = layer[place];
    const green = layer[place + 1];
    const blue = layer[place + 2];
    sum[place] += a * red + b * green + c * blue;
    sum[place + 1] += d * red + e * green + f * blue;
    sum[place + 2] += g * red + h * green + i * blue;
  }
}

/** Code values of a sum and one more layer through its matrix. */
function encode(codes, sum, layer, [a, b, c, d, e, f, g, h, i]) {
  const curve = toneCurve();
  const [forRed, forGreen, forBlue] = WHITE;
  for (let pixel = 0, place = 0; pixel < codes.length; pixel++, place += 3) {
    const x = layer[place];
    const y = layer[place + 1];
    const z = layer[place + 2];
    let red = sum[place] + a * x + b * y + c * z;
    let green = sum[place + 1] + d * x + e * y + f * z;
    let blue = sum[place + 2] + g * x + h * y + i * z;
    if (red < 0 || green < 0 || blue < 0 || red > 1 || green > 1 || blue > 1) {
      // what the screen cannot show moves towards the grey of its luminance, as in our files:
      // at least half of what the channels above 0 give, or deep blue light would be black
      const lit = forRed * Math.max(0, red) + forGreen * Math.max(0, green) + forBlue * Math.max(0, blue);
      const grey = Math.min(1, Math.max(0.5 * lit, forRed * red + forGreen * green + forBlue * blue));
      const share = Math.min(1, room(red, grey), room(green, grey), room(blue, grey));
      red = grey + share * (red - grey);
      green = grey + share * (green - grey);
      blue = grey + share * (blue - grey);
    }
    codes[pixel] =
      0xff000000 |
      (curve[(blue * STEPS + 0.5) | 0] << 16) |
      (curve[(green * STEPS + 0.5) | 0] << 8) |
      curve[(red * STEPS + 0.5) | 0];
  }
}

function room(value, grey) {
  const away = value - grey;
  return (away > 0 ? 1 - grey : grey) / Math.max(Math.abs(away), 1e-12);
}

let tones = null;

/** Code values of linear light in even steps. */
function toneCurve() {
  tones ??= Uint8Array.from({ length: STEPS + 2 }, (_, step) => {
    const light = Math.min(1, step / STEPS);
    return Math.round(255 * (light <= 0.0031308 ? 12.92 * light : 1.055 * light ** (1 / 2.4) - 0.055));
  });
  return tones;
}

/** Stripes where the layers were filled in. */
function markFilled(codes, { sure, columns, left, top }) {
  for (let pixel = 0; pixel < codes.length; pixel++) {
    if (sure[pixel] >= 0.5) continue;
    const along = left + top + (pixel % columns) + Math.floor(pixel / columns);
    const share = along % 10 < 5 ? 0.25 : 0.7;
    const old = codes[pixel];
    codes[pixel] = STRIPES.reduce((code, colour, channel) => {
      const was = (old >> (8 * channel)) & 255;
      return code | (Math.round(was + share * (colour - was)) << (8 * channel));
    }, 0xff000000);
  }
}
