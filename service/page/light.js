// A picture of layers on a canvas: what of it is shown, and when it is drawn.

import { Detail } from "./detail.js";
import { fit, followScreen, hasGraphicsCard, open, surroundings } from "./gl.js";
import { Graphics } from "./graphics.js";
import { Processor } from "./processor.js";

const LARGEST = 16; // screen pixels for one of the photograph
const COARSER = [1, 1.4, 2, 2.8, 4]; // pixels of the screen along the side of one that is drawn
const SETTLED_MS = 150; // after the last change, a picture that was drawn coarsely is drawn anew
const QUICK_MS = 24; // a frame that takes less may have more pixels while something is dragged
const WANTED_MS = 30;
const SLOW_MS = 36;
const LEAST_PIXELS = 200000;

/** A picture of layers that can be moved and enlarged.
 *
 * A graphics card draws it, or the processor where there is none. Where that takes too long it is
 * drawn coarsely while something moves. The canvas is aria-busy until what it shows is exact.
 */
export class Light {
  /** canvas: where. preview: of readExr. step: pixels of the photograph along the side of one of it.
   * fetchArea(left, top, width, height): layers of an area of the photograph. signal: ends with the view.
   */
  constructor(canvas, preview, step, fetchArea, signal) {
    this.canvas = canvas;
    this.step = step;
    this.size = [preview.width, preview.height];
    this.lamps = [...preview.channels.keys()].filter((name) => name.endsWith(".R")).length;
    this.split = 0;
    this.marked = false;
    this.drawn = () => {}; // called with every picture that is drawn
    const gl = hasGraphicsCard(Math.max(...this.size)) ? open(canvas, signal) : null;
    this._painter = gl
      ? new Graphics(gl, preview, this.lamps)
      : new Processor(canvas.getContext("2d", { alpha: false, willReadFrequently: true }), preview, this.lamps);
    this._detail = new Detail(this, fetchArea);
    signal.addEventListener("abort", () => this._detail.leave());
    this._zoom = null; // null: the whole picture
    this._middle = [preview.width / 2, preview.height / 2];
    this._budget = Infinity; // pixels that can be drawn quickly enough
    this._changed = 0; // when
    this._stale = false;
    this._coarse = false;
    this._ticking = false;
    this._last = 0; // when the last frame of the screen began
    this._took = 0; // how long the one before it took, in ms
    this._drew = false; // whether the last frame drew a picture
    this._resized = false; // and did so on a canvas of another size
    new ResizeObserver(() => this.draw()).observe(canvas);
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault()); // else it never came back
    canvas.addEventListener("webglcontextrestored", () => this._restore());
    followScreen(() => this.draw(), signal);
  }

  /** Show the layers through these matrices; before: those left of the split. */
  show(now, before) {
    this._now = now;
    this._before = before;
    this.draw();
  }

  /** Mark the places whose layers were filled in, or no longer. */
  mark(on) {
    this.marked = on;
    this.draw();
  }

  /** Draw with the next frame of the screen. */
  draw() {
    if (!this._now) return;
    this._stale = true;
    this._changed = performance.now();
    this.canvas.setAttribute("aria-busy", "true");
    this._tick();
  }

  /** Screen pixels for one of the preview; null shows the whole picture. */
  zoom(value) {
    this._zoom = value;
    this.draw();
  }

  /** Enlarge by a factor around a point of the page, from the canvas' corner; else its middle. */
  enlarge(factor, x = this.canvas.clientWidth / 2, y = this.canvas.clientHeight / 2) {
    const room = this._room();
    const old = this._scale(room);
    const corner = this._corner(room, old);
    const point = [x * devicePixelRatio, y * devicePixelRatio];
    const held = point.map((value, axis) => (value - corner[axis]) / old);
    const wanted = Math.min(LARGEST * this.step, old * factor);
    const whole = this._whole(room);
    // a small picture is smaller than that pixel by pixel, and no smaller yet
    this._zoom = old >= whole && wanted <= whole ? null : Math.max(wanted, Math.min(old, this.step, whole));
    const scale = this._scale(room);
    this._middle = held.map((value, axis) => value - (point[axis] - room[axis] / 2) / scale);
    this.draw();
  }

  /** Where the preview lies on the page: its corner from the canvas' one, and how long the side of one of its pixels is. */
  place() {
    const room = this._room();
    const scale = this._scale(room);
    const corner = this._corner(room, scale);
    return { corner: corner.map((value) => value / devicePixelRatio), scale: scale / devicePixelRatio };
  }

  /** Move the picture by pixels of the page. */
  move(x, y) {
    const step = devicePixelRatio / this._scale(this._room());
    this._middle = [this._middle[0] - x * step, this._middle[1] - y * step];
    this.draw();
  }

  _restore() {
    this._painter.restore();
    this._detail.forget();
    this.draw();
  }

  _tick() {
    if (this._ticking) return;
    this._ticking = true;
    requestAnimationFrame((time) => {
      this._ticking = false;
      this._frame(time);
    });
  }

  /** One frame of the screen; they follow each other until the picture is drawn sharply. */
  _frame(time) {
    if (!this.canvas.isConnected) return;
    if (this._drew && !this._resized) this._learn(time - this._last); // another size takes longer, once
    this._last = time;
    const settled = performance.now() - this._changed > SETTLED_MS;
    this._drew = this._stale || (this._coarse && settled);
    if (this._drew) this._draw(this._stale);
    if (this._coarse || !settled) this._tick();
    else {
      this._drew = false;
      this._settle();
    }
  }

  /** Learn from the time that a frame took, with the one before it, how many pixels to draw. */
  _learn(took) {
    const mean = (took + this._took) / 2;
    this._took = took;
    if (mean > SLOW_MS) {
      const pixels = this.canvas.width * this.canvas.height;
      this._budget = Math.max(LEAST_PIXELS, Math.min(this._budget, (pixels * WANTED_MS) / mean));
    } else if (mean < QUICK_MS) {
      this._budget *= 1.05;
    }
  }

  /** The picture is drawn sharply: fetch what the preview lacks for it. */
  async _settle() {
    const room = this._room();
    const scale = this._scale(room);
    const fetched = this._detail.look(room, this._corner(room, scale), scale);
    if (!fetched) this.canvas.setAttribute("aria-busy", "false");
    else if (await fetched) this.draw();
    else if (!this._ticking) this.canvas.setAttribute("aria-busy", "false");
  }

  /** Show a part of the photograph in full size. */
  showDetail(part) {
    this._painter.showDetail(part);
  }

  _draw(moving) {
    const room = this._room();
    const wanted = Math.sqrt((room[0] * room[1]) / this._budget);
    const coarseness = moving ? (COARSER.find((one) => one >= wanted) ?? COARSER.at(-1)) : 1;
    this._resized = fit(this.canvas, coarseness);
    const { width, height } = this.canvas;
    const scale = this._scale(room) / coarseness;
    const coarse = coarseness > 1;
    const sharp = this._painter.draw({
      width,
      height,
      scale,
      corner: this._corner(room, scale * coarseness).map((value) => value / coarseness),
      smooth: !(scale === 1 || scale >= 2) && !coarse,
      level: Math.max(0, Math.floor(Math.log2(1 / scale) + (coarse ? 0.5 : 0))),
      split: this.split * width,
      marked: this.marked,
      detailed: scale * coarseness > 1 && !this.marked,
      around: surroundings(this.canvas),
      now: this._now,
      before: this._before,
      moving,
    });
    this._coarse = coarse || !sharp;
    this._stale = false;
    this.drawn();
  }

  /** Pixels of the screen that the canvas takes. */
  _room() {
    const ratio = devicePixelRatio;
    return [this.canvas.clientWidth, this.canvas.clientHeight].map((side) => Math.max(1, Math.round(side * ratio)));
  }

  _scale(room) {
    return this._zoom ?? this._whole(room);
  }

  _whole(room) {
    return Math.min(room[0] / this.size[0], room[1] / this.size[1], 4);
  }

  /** Upper left corner of the picture on the screen; whole pixels, so that 1:1 is exact. */
  _corner(room, scale) {
    return room.map((side, axis) => {
      const shown = this.size[axis] * scale;
      if (shown <= side) return Math.round((side - shown) / 2);
      const corner = Math.min(0, Math.max(side - shown, side / 2 - this._middle[axis] * scale));
      this._middle[axis] = (side / 2 - corner) / scale;
      return Math.round(corner);
    });
  }
}
