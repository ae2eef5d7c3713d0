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
uniform float marked;   // 1: stripes where layers are filled in
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
  bool old = place.x < split;
  bool exact = scale == 1.0 || scale >= 2.0;
  vec3 light = vec3(0.0);
  float sure = 1.0;
  ${Array.from({ length: lamps }, (_, lamp) => `{
    vec4 one = exact ? texelFetch(layers[${lamp}], ivec2(point), 0)
                     : textureLod(layers[${lamp}], point / size, max(0.0, -log2(scale)));
    light += (old ? before[${lamp}] : now[${lamp}]) * one.rgb;
    sure = one.a;
  }`).join("\n")}
  vec3 shown = encoded(fitting(light));
  if (marked > 0.5 && sure < 0.5 && !old) {
    float stripe = step(5.0, mod(place.x + place.y, 10.0));
    shown = mix(shown, vec3(1.0, 0.25, 0.75), 0.25 + 0.45 * stripe);
  }
  colour = vec4(split > 0.0 && abs(place.x - split) < 1.0 ? vec3(1.0) : shown, 1.0);
}`;

/** A picture of layers that can be moved and enlarged. */
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
    this._waiting = false;
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
    if (this._waiting || !this._now) return;
    this._waiting = true;
    requestAnimationFrame(() => {
      this._waiting = false;
      this._draw();
    });
  }

  /** Screen pixels for one of the preview; null shows the whole picture. */
  zoom(value) {
    this._zoom = value;
    this.draw();
  }

  get scale() {
    return this._zoom ?? this._whole();
  }

  /** Enlarge by a factor around a point of the screen, from the canvas' corner; else its middle. */
  enlarge(factor, x = this.canvas.clientWidth / 2, y = this.canvas.clientHeight / 2) {
    const [left, top] = this._corner();
    const old = this.scale;
    const ratio = devicePixelRatio;
    const held = [(x * ratio - left) / old, (y * ratio - top) / old];
    const wanted = Math.min(16, old * factor);
    this._zoom = wanted <= this._whole() ? null : wanted;
    const away = [x * ratio - this.canvas.width / 2, y * ratio - this.canvas.height / 2];
    this._middle = held.map((value, axis) => value - away[axis] / this.scale);
    this.draw();
  }

  /** Move the picture by pixels of the page. */
  move(x, y) {
    const step = devicePixelRatio / this.scale;
    this._middle = [this._middle[0] - x * step, this._middle[1] - y * step];
    this.draw();
  }

  _load(preview) {
    const gl = this._gl;
    const renders = gl.getExtension("EXT_color_buffer_float") ?? gl.getExtension("EXT_color_buffer_half_float");
    const smaller = renders ? gl.LINEAR_MIPMAP_LINEAR : gl.LINEAR;
    for (let lamp = 0; lamp < this.lamps; lamp++) {
      const channel = (letter) => preview.channels.get(`lamp${lamp + 1}.${letter}`);
      const data = interleave(channel("R"), channel("G"), channel("B"), preview.channels.get("Y"));
      texture(gl, lamp, smaller, gl.LINEAR);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, ...this.size, 0, gl.RGBA, gl.HALF_FLOAT, data);
      if (renders) gl.generateMipmap(gl.TEXTURE_2D);
    }
    gl.uniform1iv(this._place("layers"), [...Array(this.lamps).keys()]);
    gl.uniform2fv(this._place("size"), this.size);
  }

  _whole() {
    const { width, height } = this.canvas;
    return Math.min(width / this.size[0], height / this.size[1], 4);
  }

  /** Upper left corner of the picture on the canvas; whole pixels, so that 100 % is exact. */
  _corner() {
    const { width, height } = this.canvas;
    const scale = this.scale;
    return [width, height].map((room, axis) => {
      const shown = this.size[axis] * scale;
      const middle = Math.min(Math.max(this._middle[axis], 0), this.size[axis]);
      const free = room / 2 - middle * scale;
      const corner = shown <= room ? (room - shown) / 2 : Math.min(0, Math.max(room - shown, free));
      if (shown > room) this._middle[axis] = (room / 2 - corner) / scale;
      return Math.round(corner);
    });
  }

  _draw() {
    const gl = this._gl;
    if (!this.canvas.isConnected) return;
    fit(this.canvas);
    gl.viewport(0, 0, this.canvas.width, this.canvas.height);
    gl.uniform2f(this._place("canvas"), this.canvas.width, this.canvas.height);
    gl.uniform2fv(this._place("corner"), this._corner());
    gl.uniform1f(this._place("scale"), this.scale);
    gl.uniform1f(this._place("split"), this.split * this.canvas.width);
    gl.uniform1f(this._place("marked"), this.marked ? 1 : 0);
    gl.uniform3fv(this._place("around"), surroundings(this.canvas));
    gl.uniformMatrix3fv(this._place("now"), true, this._now.flat());
    gl.uniformMatrix3fv(this._place("before"), true, this._before.flat());
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}
