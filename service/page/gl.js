// What both pictures drawn by WebGL need: a program over the whole canvas, and textures.

const VERTEX = `#version 300 es
void main() {
  gl_Position = vec4(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0, 0.0, 1.0);
}`;

const SOFTWARE = /swiftshader|llvmpipe|softpipe|basic render|software/i;

/** WebGL 2 of a canvas, null where the browser has none. signal: ends with the view, and gives back what it takes of the graphics card. */
export function open(canvas, signal) {
  const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false, stencil: false });
  signal.addEventListener("abort", () => gl?.getExtension("WEBGL_lose_context")?.loseContext());
  return gl;
}

/** Whether there is WebGL 2 done by a graphics card, as far as the browser tells, for pictures of so many pixels to a side. */
export function hasGraphicsCard(side) {
  const gl = document.createElement("canvas").getContext("webgl2");
  const told = gl?.getExtension("WEBGL_debug_renderer_info");
  const software = told && SOFTWARE.test(gl.getParameter(told.UNMASKED_RENDERER_WEBGL));
  const large = side <= gl?.getParameter(gl.MAX_TEXTURE_SIZE); // else nothing were drawn
  gl?.getExtension("WEBGL_lose_context")?.loseContext();
  return large && !software;
}

/** A program that runs a fragment shader for every pixel of the canvas. */
export function build(gl, fragment) {
  const program = gl.createProgram();
  for (const [type, text] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  gl.useProgram(program);
  return (name) => gl.getUniformLocation(program, name);
}

/** Make a texture the current one of number `unit`, with these filters. */
export function texture(gl, unit, smaller, larger) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  const made = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, made);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, smaller);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, larger);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  return made;
}

/** Linear light to the code values of sRGB, by roots, which are quicker than powers and 0.01 of 255 off. */
export const SRGB = `
vec3 encoded(vec3 light) {
  vec3 c = clamp(light, 0.0, 1.0);
  vec3 half_ = sqrt(c);
  vec3 quarter = sqrt(half_);
  vec3 curve = 0.653985193 * half_ + 0.688708990 * quarter - 0.318469118 * sqrt(quarter)
    - 0.0201874727 * c - 0.00406882934;
  return mix(curve, 12.92 * c, lessThanEqual(c, vec3(0.0031308)));
}`;

/** The colour around a picture, 0…255. */
export function surroundings(canvas) {
  return getComputedStyle(canvas).backgroundColor.match(/[\d.]+/g).slice(0, 3).map(Number);
}

/** Call draw() where colours change, or how many pixels of the screen one of the page takes, as on another screen. signal: ends it. */
export function followScreen(draw, signal) {
  matchMedia("(prefers-color-scheme: light)").addEventListener("change", draw, { signal }); // else it were kept in memory
  const followRatio = () => {
    const again = () => {
      followRatio();
      draw();
    };
    matchMedia(`(resolution: ${devicePixelRatio}dppx)`).addEventListener("change", again, { once: true, signal });
  };
  followRatio();
}

/** Give a canvas as many pixels as the screen shows of it, or fewer by the square of a factor; whether it had others. */
export function fit(canvas, coarseness = 1) {
  const ratio = devicePixelRatio / coarseness;
  const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
  const height = Math.max(1, Math.round(canvas.clientHeight * ratio));
  if (canvas.width === width && canvas.height === height) return false;
  Object.assign(canvas, { width, height });
  return true;
}
