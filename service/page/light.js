// The sum of the layers on the screen: linear light, one matrix for each lamp, tone curve last.

import { interleave } from "./exr.js";
import { SRGB, build, fit, open, surroundings, texture } from "./gl.js";

const shader = (lamps) => `#version 300 es
precision highp float;
precision highp sampler2D;
uniform sampler2D layers[${lamps}];
uniform mat3 now[${lamps}];
uniform mat3 before[${lamps}];
uniform vec2 corner;    // of the picture on the canvas, in pixels from above
uniform vec2 canvas;
uniform vec2 size;      // of the picture in its own pixels
uniform float scale;    // canvas pixels for one of the picture
uniform float split;    // canvas pixels from the left that show the photograph as it was
uniform bool smooth_;   // between pixels of the picture
uniform int level;      // of the picture's smaller copies
uniform bool marked;    // stripes where layers are filled in
uniform vec3 around;
out vec4 colour;
${SRGB}
// Colours that the screen cannot show move towards the grey of their luminance, as in our files.
vec3 fitting(vec3 c) {
  float grey = clamp(dot(c, vec3(0.2126390058715103, 0.7151686787677559, 0.0721923153607337)), 0.0, 1.0);
  vec3 away = c - grey;
  vec3 room = mix(vec3(grey), vec3(1.0 - grey), greaterThan(away, vec3(0.0)));
  vec3 share = min(room / max(abs(away), 1e-12), 1.0);
  return grey + min(share.r, min(share.g, share.b)) * away;
}
void main() {
  vec2 place = vec2(gl_FragCoord.x, canvas.y - gl_FragCoord.y);
  vec2 point = (place - corner) / scale;
  if (any(lessThan(point, vec2(0.0))) || any(greaterThanEqual(point, size))) {
    colour = vec4(around, 1.0);
    return;
  }
  vec4 one[${lamps}];
  if (smooth_) {
    ${each(lamps, (lamp) => `one[${lamp}] = textureLod(layers[${lamp}], point / size, float(level));`)}
  } else {
    ivec2 last = textureSize(layers[0], level) - 1;
    ivec2 pixel = min(ivec2(point) >> level, last);
    ${each(lamps, (lamp) => `one[${lamp}] = texelFetch(layers[${lamp}], pixel, level);`)}
  }
  vec3 light = vec3(0.0);
  bool old = place.x < split;
  if (old) {
    ${each(lamps, (lamp) => `light += before[${lamp}] * one[${lamp}].rgb;`)}
  } else {
    ${each(lamps, (lamp) => `light += now[${lamp}] * one[${lamp}].rgb;`)}
  }
  vec3 shown = encoded(fitting(light));
  if (marked && one[0].a < 0.5 && !old) {
    float stripe = step(5.0, mod(place.x + place.y, 10.0));
    shown = mix(shown, vec3(1.0, 0.25, 0.75), 0.25 + 0.45 * stripe);
  }
  colour = vec4(split > 0.0 && abs(place.x - split) < 1.0 ? vec3(1.0) : shown, 1.0);
}`;

const each = (count, line) => Array.from({ length: count }, (_, index) => line(index)).join("\n    ");

const LARGEST = 16; // screen pixels for one of the picture
const SETTLED_MS = 150; // after the last change, a picture that was drawn coarsely is drawn anew
const QUICK_MS = 20; // what a frame is to take while something is dragged
const SLOW_MS = 30;
const LEAST_PIXELS = 200000;

/** A picture of layers that can be moved and enlarged.
 *
 * Where the machine draws too slowly for that it is drawn coarsely while something moves. The
 * canvas is aria-busy until what it shows is exact.
 */
export class Light {
  /** canvas: where. preview: of readExr. Throws an Error where the browser has no WebGL 2. */
  constructor(canvas, preview) {
    const gl = open(canvas);
    if (!gl) throw new Error("This browser cannot show the mixer: it has no WebGL 2.");
    this.canvas = canvas;
    this.size = [preview.width, preview.height];
    this.lamps = [...preview.channels.keys()].filter((name) => name.endsWith(".R")).length;
    this.split = 0;
    this.marked = false;
    this._gl = gl;
    this._zoom = null; // null: the whole picture
    this._middle = [preview.width / 2, preview.height / 2];
    this._place = build(gl, shader(this.lamps));
    this._load(preview);
    this._budget = Infinity; // pixels that can be drawn quickly enough
    this._changed = 0; // when
    this._stale = false;
    this._coarse = false;
    this._ticking = false;
    this._last = 0; // when the last frame of the screen began
    this._took = 0; // how long the one before it took, in ms
    this._drew = false; // whether the last frame drew a picture
    new ResizeObserver(() => this.draw()).observe(canvas);
    matchMedia("(prefers-color-scheme: light)").addEventListener("change", () => this.draw());
  }

  /** Show the layers through these matrices; before: those left of the split. */
  show(now, before) {
    this._now = now;
    this._before = before;
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
    const wanted = Math.min(LARGEST, old * factor);
    this._zoom = wanted <= this._whole(room) ? null : wanted;
    const scale = this._scale(room);
    this._middle = held.map((value, axis) => value - (point[axis] - room[axis] / 2) / scale);
    this.draw();
  }

  /** Move the picture by pixels of the page. */
  move(x, y) {
    const step = devicePixelRatio / this._scale(this._room());
    this._middle = [this._middle[0] - x * step, this._middle[1] - y * step];
    this.draw();
  }

  _load(preview) {
    const gl = this._gl;
    const renders = gl.getExtension("EXT_color_buffer_float") ?? gl.getExtension("EXT_color_buffer_half_float");
    this._levels = renders ? Math.floor(Math.log2(Math.max(...this.size))) : 0;
    for (let lamp = 0; lamp < this.lamps; lamp++) {
      const channel = (letter) => preview.channels.get(`lamp${lamp + 1}.${letter}`);
      const data = interleave(channel("R"), channel("G"), channel("B"), preview.channels.get("Y"));
      texture(gl, lamp, renders ? gl.LINEAR_MIPMAP_NEAREST : gl.LINEAR, gl.LINEAR);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, ...this.size, 0, gl.RGBA, gl.HALF_FLOAT, data);
      if (renders) gl.generateMipmap(gl.TEXTURE_2D);
    }
    gl.uniform1iv(this._place("layers"), [...Array(this.lamps).keys()]);
    gl.uniform2fv(this._place("size"), this.size);
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
    if (this._drew) this._learn(time - this._last);
    this._last = time;
    const settled = performance.now() - this._changed > SETTLED_MS;
    this._drew = this._stale || (this._coarse && settled);
    if (this._drew) this._draw(this._stale);
    if (this._coarse || !settled) this._tick();
    else {
      this._drew = false;
      this.canvas.setAttribute("aria-busy", "false");
    }
  }

  /** Learn from the time that a frame took, with the one before it, how many pixels to draw. */
  _learn(took) {
    const mean = (took + this._took) / 2;
    this._took = took;
    if (mean > SLOW_MS) {
      const pixels = this.canvas.width * this.canvas.height;
      this._budget = Math.max(LEAST_PIXELS, Math.min(this._budget, (pixels * QUICK_MS) / mean));
    } else if (mean < QUICK_MS) {
      this._budget *= 1.05;
    }
  }

  _draw(moving) {
    const gl = this._gl;
    const room = this._room();
    const coarseness = moving ? Math.max(1, Math.sqrt((room[0] * room[1]) / this._budget)) : 1;
    this._coarse = coarseness > 1;
    this._stale = false;
    fit(this.canvas, coarseness);
    const { width, height } = this.canvas;
    const scale = this._scale(room) / coarseness;
    const exact = scale === 1 || scale >= 2;
    const level = Math.max(0, Math.min(this._levels, Math.floor(Math.log2(1 / scale) + (this._coarse ? 0.5 : 0))));
    gl.viewport(0, 0, width, height);
    gl.uniform2f(this._place("canvas"), width, height);
    gl.uniform2fv(this._place("corner"), this._corner(room, scale * coarseness).map((value) => value / coarseness));
    gl.uniform1f(this._place("scale"), scale);
    gl.uniform1f(this._place("split"), this.split * width);
    gl.uniform1i(this._place("smooth_"), !exact && !this._coarse);
    gl.uniform1i(this._place("level"), level);
    gl.uniform1i(this._place("marked"), this.marked);
    gl.uniform3fv(this._place("around"), surroundings(this.canvas));
    gl.uniformMatrix3fv(this._place("now"), true, this._now.flat());
    gl.uniformMatrix3fv(this._place("before"), true, this._before.flat());
    gl.drawArrays(gl.TRIANGLES, 0, 3);
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
