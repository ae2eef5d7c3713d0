// Circles over a picture of layers, and taps on it that make them.

const SVG = "http://www.w3.org/2000/svg";
const STILL = 6; // pixels of the page that a finger may move in a tap

/** Circles that stay where they are on the photograph while that is moved and enlarged. */
export class Spots {
  /** light: the picture; step: pixels of the photograph along the side of one of its preview. */
  constructor(light, step) {
    this._light = light;
    this._step = step;
    this._circles = [];
    this._over = svg("svg", { class: "spots", "aria-hidden": "true" });
    light.drawn = () => this._draw();
  }

  /** Show circles: of each x, y and radius in pixels of the photograph, number, and whether it is forbidden. */
  show(circles) {
    this._circles = circles;
    this._draw();
  }

  /** The place in the photograph, in its pixels, at a point of the page, from the canvas' corner; else in the middle. */
  at(point = [this._light.canvas.clientWidth / 2, this._light.canvas.clientHeight / 2]) {
    const { corner, scale } = this._light.place();
    return point.map((value, axis) => ((value - corner[axis]) / scale) * this._step);
  }

  _draw() {
    const { canvas } = this._light;
    if (canvas.isConnected && canvas.nextSibling !== this._over) canvas.after(this._over); // another view may have been shown
    const { corner, scale } = this._light.place();
    const full = scale / this._step;
    this._over.replaceChildren(
      ...this._circles.map((one) => ring(corner[0] + one.x * full, corner[1] + one.y * full, one.radius * full, one.number, one.forbidden)),
    );
  }
}

/** A ring with its number, struck through where a lamp is forbidden: dark around light, to be seen on any picture. */
function ring(x, y, radius, number, forbidden) {
  const r = Math.max(1, radius);
  const side = r * Math.SQRT1_2;
  const shapes = () => [
    svg("circle", { cx: x, cy: y, r }),
    ...(forbidden ? [svg("line", { x1: x - side, y1: y + side, x2: x + side, y2: y - side })] : []),
    svg("text", { x: x + side + 4, y: y - side - 4 }, number),
  ];
  return svg("g", {}, svg("g", { class: "edge" }, ...shapes()), svg("g", { class: "line" }, ...shapes()));
}

function svg(tag, attributes, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...children);
  return element;
}

/** Call work(x, y), from the canvas' corner, where it is clicked or tapped, and neither moved nor enlarged by that. */
export function onTap(canvas, work) {
  let start = null;
  canvas.addEventListener("pointerdown", (event) => {
    start = event.isPrimary ? [event.offsetX, event.offsetY] : null; // two fingers enlarge
  });
  canvas.addEventListener("pointermove", (event) => {
    if (start && Math.hypot(event.offsetX - start[0], event.offsetY - start[1]) > STILL) start = null;
  });
  canvas.addEventListener("click", () => start && work(...start));
}
