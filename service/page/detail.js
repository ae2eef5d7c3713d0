// What the preview lacks: the area that is on the screen in the photograph's own pixels.

const MOST_PIXELS = 2 ** 21; // of an area that is asked for, as of a preview

/** The one area in full size that a Light shows. */
export class Detail {
  constructor(light, fetchArea) {
    this._light = light;
    this._fetch = fetchArea;
    this._shown = null; // left, top, right, bottom in pixels of the photograph
    this._asked = null; // the same, of what is on its way, with the promise of it
    this._failed = false;
  }

  /** Look whether an area is worth fetching; if so a promise, of whether it is shown now.
   *
   * room: of the canvas; corner, scale: of the preview on it, in pixels of the screen.
   */
  look(room, corner, scale) {
    const { step, size } = this._light;
    if (step === 1 || scale <= 1 || this._failed) return null;
    const full = scale / step;
    const area = [0, 1].map((axis) => Math.max(0, Math.floor(-corner[axis] / full)));
    const ends = [0, 1].map((axis) => Math.min(step * size[axis], Math.ceil((room[axis] - corner[axis]) / full)));
    const wanted = [...area, ...ends];
    if ((ends[0] - area[0]) * (ends[1] - area[1]) > MOST_PIXELS) return null;
    if (this._shown && contains(this._shown, wanted)) return null;
    if (this._asked && contains(this._asked.area, wanted)) return this._asked.shown;
    const asked = { area: wanted };
    this._asked = asked;
    asked.shown = this._show(asked);
    return asked.shown;
  }

  async _show(asked) {
    const [left, top, right, bottom] = asked.area;
    const { step } = this._light;
    try {
      const picture = await this._fetch(left, top, right - left, bottom - top);
      if (this._asked !== asked) return false;
      this._asked = null;
      this._shown = asked.area;
      this._light.showDetail({ picture, step: 1 / step, corner: [left / step, top / step] });
      return true;
    } catch (error) {
      console.error(error);
      this._failed = true; // the preview does without
      return false;
    }
  }
}

function contains([left, top, right, bottom], inner) {
  return inner[0] >= left && inner[1] >= top && inner[2] <= right && inner[3] <= bottom;
}
