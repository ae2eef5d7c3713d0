// The sum of layers drawn by the graphics card: linear light, one matrix for each lamp, tone curve last.

import { interleave } from "./exr.js";
import { SRGB, build, texture } from "./gl.js";

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
const vec3 white = vec3(0.2126390058715103, 0.7151686787677559, 0.0721923153607337);
vec3 fitting(vec3 c) {
  // at least half of what the channels above 0 give, or deep blue light would be black
  float grey = min(max(dot(c, white), 0.5 * dot(max(c, 0.0), white)), 1.0);
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

export class Graphics {
  /** gl: WebGL 2 of the canvas; preview: of readExr, of so many lamps. */
  constructor(gl, preview, lamps) {
    this._gl = gl;
    this._lamps = lamps;
    this._source = preview;
    this.restore();
  }

  /** Load all but the part in full size; a context that was lost comes back empty. */
  restore() {
    const gl = this._gl;
    const { width, height } = this._source;
    this._place = build(gl, shader(this._lamps));
    const renders = gl.getExtension("EXT_color_buffer_float") ?? gl.getExtension("EXT_color_buffer_half_float");
    this._levels = renders ? Math.floor(Math.log2(Math.max(width, height))) : 0;
    this._preview = this._load(this._source, renders);
    this._detail = null;
  }

  /** Draw a view; gives whether that is as sharp as it can be. */
  draw(view) {
    const gl = this._gl;
    gl.viewport(0, 0, view.width, view.height);
    gl.uniform2f(this._place("canvas"), view.width, view.height);
    gl.uniform1f(this._place("split"), view.split);
    gl.uniform3fv(this._place("around"), view.around.map((code) => code / 255));
    gl.uniformMatrix3fv(this._place("now"), true, view.now.flat());
    gl.uniformMatrix3fv(this._place("before"), true, view.before.flat());
    this._draw(view, this._preview, this._levels);
    if (this._detail && view.detailed) this._drawDetail(view);
    return true;
  }

  /** Show a part in full size over the preview; null takes it away. part: place and size in pixels of the preview. */
  showDetail(part) {
    this._detail?.textures.forEach((one) => this._gl.deleteTexture(one));
    this._detail = part && { ...this._load(part.picture, false), part };
  }

  _drawDetail(view) {
    const { part } = this._detail;
    const scale = view.scale * part.step;
    const corner = view.corner.map((side, axis) => side + view.scale * part.corner[axis]);
    const gl = this._gl;
    const ends = corner.map((side, axis) => side + scale * this._detail.size[axis]);
    const [left, top] = corner.map((side) => Math.ceil(side - 0.5));
    const [right, bottom] = ends.map((side) => Math.ceil(side - 0.5));
    gl.enable(gl.SCISSOR_TEST);
    gl.scissor(left, view.height - bottom, Math.max(0, right - left), Math.max(0, bottom - top));
    this._draw({ ...view, scale, corner, smooth: scale < 2 && scale !== 1 }, this._detail, 0);
    gl.disable(gl.SCISSOR_TEST);
  }

  _draw(view, { textures, size }, levels) {
    const gl = this._gl;
    textures.forEach((one, unit) => {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_2D, one);
    });
    gl.uniform1iv(this._place("layers"), [...textures.keys()]);
    gl.uniform2fv(this._place("size"), size);
    gl.uniform2fv(this._place("corner"), view.corner);
    gl.uniform1f(this._place("scale"), view.scale);
    gl.uniform1i(this._place("smooth_"), view.smooth);
    gl.uniform1i(this._place("level"), Math.min(levels, view.level));
    gl.uniform1i(this._place("marked"), view.marked);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  _load(picture, mipmaps) {
    const gl = this._gl;
    const size = [picture.width, picture.height];
    const textures = Array.from({ length: this._lamps }, (_, lamp) => {
      const one = texture(gl, lamp, mipmaps ? gl.LINEAR_MIPMAP_NEAREST : gl.LINEAR, gl.LINEAR);
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA16F, ...size, 0, gl.RGBA, gl.HALF_FLOAT, interleave(picture, lamp));
      if (mipmaps) gl.generateMipmap(gl.TEXTURE_2D);
      return one;
    });
    return { textures, size };
  }
}
