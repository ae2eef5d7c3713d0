// The normals under a light that follows the pointer.

import { isShortcut } from "./dom.js";
import { SRGB, build, fit, followScreen, open, surroundings, texture } from "./gl.js";

const SHADER = `#version 300 es
precision highp float;
uniform sampler2D normals;
uniform vec2 canvas;
uniform vec2 size;
uniform vec3 lamp;  // from the surface to the light; x right, y up, z to the viewer
uniform vec3 axes;  // 1, or -1 where the normals have the axis the other way
uniform vec3 around;
out vec4 colour;
${SRGB}
vec3 pixelAt(vec2 place) {
  return texelFetch(normals, ivec2(clamp(place, vec2(0.0), size - 1.0)), 0).rgb;
}
// Between pixels, but not between one and none, which is black: that were a direction of its own.
vec3 codeAt(vec2 place) {
  vec2 low = floor(place - 0.5);
  for (int next = 0; next < 4; next++) {
    if (pixelAt(low + vec2(next % 2, next / 2)) == vec3(0.0)) return pixelAt(floor(place));
  }
  return textureLod(normals, place / size, 0.0).rgb;
}
void main() {
  float scale = min(canvas.x / size.x, canvas.y / size.y);
  vec2 place = vec2(gl_FragCoord.x, canvas.y - gl_FragCoord.y);
  vec2 point = (place - 0.5 * (canvas - scale * size)) / (scale * size);
  vec3 code = codeAt(point * size);
  bool outside = any(lessThan(point, vec2(0.0))) || any(greaterThan(point, vec2(1.0)));
  if (outside || code == vec3(0.0)) {
    colour = vec4(around, 1.0);
    return;
  }
  float lit = max(dot(axes * normalize(2.0 * code - 1.0), normalize(lamp)), 0.0);
  colour = vec4(encoded(vec3(0.02 + 0.8 * lit)), 1.0);
}`;

const LONGEST = 2048; // pixels of the normals that are shown

/** Show normals, a picture, on a canvas, lit from where the pointer or the arrow keys say.
 *
 * convention: the job's option normals; "dx" has y downwards. signal: ends with the view. The canvas
 * is aria-busy until it follows them.
 */
export async function relight(canvas, blob, convention, signal) {
  canvas.setAttribute("aria-busy", "true");
  try {
    await prepare(canvas, blob, convention, signal);
    canvas.setAttribute("aria-busy", "false");
  } catch (error) {
    canvas.removeAttribute("aria-busy"); // else it were busy for ever
    throw error;
  }
}

async function prepare(canvas, blob, convention, signal) {
  const gl = open(canvas, signal);
  if (!gl) throw new Error("This browser cannot show normals: it has no WebGL 2.");
  const whole = await createImageBitmap(blob, {
    colorSpaceConversion: "none",
    premultiplyAlpha: "none",
  });
  const scale = Math.min(1, LONGEST / Math.max(whole.width, whole.height));
  const size = [Math.round(whole.width * scale), Math.round(whole.height * scale)];
  const resized = { resizeWidth: size[0], resizeHeight: size[1], resizeQuality: "pixelated" }; // between none and one lies no normal
  const picture = await createImageBitmap(whole, resized);
  whole.close();
  if (signal.aborted) return picture.close();
  signal.addEventListener("abort", () => picture.close());
  let place;
  const load = () => {
    place = build(gl, SHADER);
    texture(gl, 0, gl.LINEAR, gl.LINEAR);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB8, gl.RGB, gl.UNSIGNED_BYTE, picture);
    gl.uniform2fv(place("size"), size);
    gl.uniform3f(place("axes"), 1, convention === "dx" ? -1 : 1, 1);
  };
  load();
  let lamp = [-0.5, 0.5];
  const draw = () => {
    if (!canvas.isConnected) return;
    fit(canvas);
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.uniform2f(place("canvas"), canvas.width, canvas.height);
    gl.uniform3f(place("lamp"), lamp[0], lamp[1], 0.6);
    gl.uniform3fv(place("around"), surroundings(canvas).map((code) => code / 255));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  };
  canvas.addEventListener("pointermove", (event) => {
    const box = canvas.getBoundingClientRect();
    lamp = [
      (2 * (event.clientX - box.left)) / box.width - 1,
      1 - (2 * (event.clientY - box.top)) / box.height,
    ];
    requestAnimationFrame(draw);
  });
  const steps = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] };
  canvas.addEventListener("keydown", (event) => {
    const step = steps[event.key];
    if (!step || isShortcut(event)) return;
    event.preventDefault();
    lamp = lamp.map((value, axis) => Math.min(1, Math.max(-1, value + step[axis])));
    requestAnimationFrame(draw);
  });
  canvas.addEventListener("webglcontextlost", (event) => event.preventDefault()); // else it never came back
  canvas.addEventListener("webglcontextrestored", () => {
    load();
    draw();
  });
  new ResizeObserver(draw).observe(canvas);
  followScreen(draw, signal);
}
