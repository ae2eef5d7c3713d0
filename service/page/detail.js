// What the preview lacks: the area that is on the screen in the photograph's own pixels.

import { key } from "./api.js";

const MOST_PIXELS = 2 ** 21; // of an area that is asked for at once, as of a preview
const AGAIN_MS = 5000; // until what failed for now is asked for again

/** The one area in full size that a Light shows. */
export class Detail {
  constructor(light, fetchArea) {
    this._light = light;
    this._fetch = fetchArea;
    this._shown = null; // left, top, right, bottom in pixels of the photograph
    this._asked = null; // the same, of what is on its way, with the promise of it
    this._refused = false;
    this._refusedKey = undefined; // the one that was not taken
    this._pauses = false; // after what failed for now
  }

  /** Look whether an area is worth fetching; if so a promise, of whether it is shown now.
   *
   * room: of the canvas; corner, scale: of the preview on it, in pixels of the screen.
   */
  look(room, corner, scale) {
    const { step, size } = this._light;
    if (step === 1 || scale <= 1 || this._refused || this._refusedKey === key()) return null;
    const full = scale / step;
    const area = [0, 1].map((axis) => Math.max(0, Math.floor(-corner[axis] / full)));
    const ends = [0, 1].map((axis) => Math.min(step * size[axis], Math.ceil((room[axis] - corner[axis]) / full)));
    const wanted = [...area, ...ends];
    const most = Math.max(MOST_PIXELS, (room[0] + 2) * (room[1] + 2)); // the canvas, wherever a pixel begins
    if ((ends[0] - area[0]) * (ends[1] - area[1]) > most) return null;
    if (this._shown && contains(this._shown, wanted)) return null;
    if (this._asked && contains(this._asked.area, wanted)) return this._asked.shown;
    if (this._pauses) return null;
    const asked = { area: wanted };
    this._asked = asked;
    asked.shown = this._show(asked);
    return asked.shown;
  }

  /** What was shown is gone: fetch it again when it is looked at. */
  forget() {
    this._shown = null;
  }

  /** Nobody looks any more: what is on its way may fail unheard. */
  leave() {
    this._asked = null;
  }

  async _show(asked) {
    const [left, top] = asked.area;
    const { step } = this._light;
    try {
      const picture = await this._gather(asked);
      if (this._asked !== asked) return this._newer();
      this._light.showDetail({ picture, step: 1 / step, corner: [left / step, top / step] });
      this._asked = null;
      this._shown = asked.area;
      return true;
    } catch (error) {
      if (this._asked !== asked) return this._newer();
      this._asked = null;
      console.error(error);
      this._fail(error); // the preview does without
      return false;
    }
  }

  /** Of an area that nobody wants any more: whether the one that is wanted instead is shown. */
  _newer() {
    return this._asked?.shown ?? false;
  }

  /** Ask no more where the service refuses, but with another key; of what fails for now again in a while. */
  _fail({ status, ofKey }) {
    if (ofKey) this._refusedKey = key();
    else this._refused = status >= 400 && status < 500;
    if (ofKey || this._refused) return;
    this._pauses = true;
    setTimeout(() => {
      this._pauses = false;
      this._light.draw();
    }, AGAIN_MS);
  }

  /** Fetch an area by strips, each of no more pixels than may be asked for; less where it is wanted no longer. */
  async _gather(asked) {
    const [left, top, right, bottom] = asked.area;
    const width = right - left;
    const most = Math.max(1, Math.floor(MOST_PIXELS / width));
    const strips = [];
    for (let row = top; row < bottom && this._asked === asked; row += most) {
      strips.push(await this._fetch(left, row, width, Math.min(most, bottom - row)));
    }
    return strips.length === 1 ? strips[0] : stacked(strips);
  }
}

/** One picture of strips that lie below each other. */
function stacked(strips) {
  const [{ width, channels }] = strips;
  const height = strips.reduce((sum, one) => sum + one.height, 0);
  const whole = [...channels.keys()].map((name) => {
    const plane = new Uint16Array(width * height);
    let start = 0;
    for (const strip of strips) {
      plane.set(strip.channels.get(name), start);
      start += width * strip.height;
    }
    return [name, plane];
  });
  return { width, height, channels: new Map(whole) };
}

function contains([left, top, right, bottom], inner) {
  return inner[0] >= left && inner[1] >= top && inner[2] <= right && inner[3] <= bottom;
}
