// Where the lamps stand, told on balls that they light: another job finds the surface's normals.

import { get } from "./api.js";
import { h, single } from "./dom.js";
import { rerun } from "./rerun.js";

const FARTHEST = 0.95; // of the ball's radius: a lamp behind the surface lights nothing
const FIRST = [[-0.5, 0.5], [0.5, 0.5], [0, 0.7]];

/** A form for a separation with two or three lamps; signal: ends with the view. */
export function normalsForm(job, manifest, signal) {
  const problems = h("div");
  const places = manifest.lamps.map((_, index) => [...FIRST[index]]);
  const balls = h("div", { className: "balls" }, ...manifest.lamps.map((lamp, index) => ball(`Lamp ${index + 1}`, lamp.srgb, places[index])));
  const calibration = h("select", {}, h("option", { value: "", textContent: "As set on the balls" }));
  calibration.addEventListener("change", () => (balls.hidden = calibration.value !== ""));
  const from = h("label", { hidden: true }, "Where the lamps stand ", calibration);
  const told = () => {
    if (calibration.value) return { calibration: calibration.value };
    return places.map(([x, y], index) => {
      const direction = [x, y, Math.sqrt(1 - x * x - y * y)];
      // colours that were found say which lamp is meant; given for all, they would count as measured
      return index < places.length - 1 ? { direction, rgb: manifest.lamps[index].rgb } : { direction };
    });
  };
  const submit = rerun(job, () => withNormals(job.options, told()), problems, signal);
  const element = h(
    "details",
    { className: "directions" },
    h("summary", { textContent: "Find the surface" }),
    h("p", { textContent: "Say from where each lamp shines, far away: move the light on its ball to where it would be on one in the scene." }),
    h("form", { onsubmit: submit }, from, balls, h("button", { textContent: "Find normals" })),
    problems,
  );
  element.addEventListener("toggle", single(async () => element.open && from.hidden && offer(calibration, from))); // opened again, it is tried again
  return element;
}

/** Options of the job, and what normals need besides. */
function withNormals(options, light_directions) {
  const { outputs } = options;
  const wanted = Array.isArray(outputs) ? { outputs: [...new Set([...outputs, "normals.png", "preview.exr", "layers.exr"])] } : {};
  return { ...options, ...wanted, light_directions };
}

/** Let lamps be taken from calibrations, where there are some; the newest at once, older ones as they are found. */
async function offer(select, label) {
  let path = "/jobs?limit=200";
  while (path && select.isConnected) {
    const { jobs, next } = await get(path).catch(() => ({ jobs: [], next: null }));
    const found = jobs.filter((one) => one.options.kind === "lamps" && one.state === "succeeded");
    for (const one of found) {
      const time = new Date(one.created).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
      select.append(h("option", { value: one.id, textContent: [`Calibration of ${time}`, ...foundWith(one.taken_with)].join(", ") }));
      label.hidden = false;
    }
    path = next;
  }
}

/** Of which camera and way up lamps are, for which they hold. */
function foundWith({ make, model, upright }) {
  const camera = `${make} ${model}`.trim() || "camera not known";
  return upright === null ? [camera] : [camera, upright ? "upright pictures" : "pictures that lie"];
}

/** A ball that is lit from place, which it changes: x to the right, y up, in radii. */
function ball(name, colour, place) {
  const picture = h("div", { className: "ball", "aria-hidden": "true" });
  const sliders = ["from the left to the right", "from below to above"].map((way, axis) =>
    h("input", {
      type: "range",
      min: -FARTHEST,
      max: FARTHEST,
      step: 0.05,
      "aria-label": `${name} ${way}`,
      oninput: (event) => move(place.map((value, index) => (index === axis ? Number(event.target.value) : value))),
    }),
  );
  const move = ([x, y]) => {
    const far = Math.max(1, Math.hypot(x, y) / FARTHEST);
    [place[0], place[1]] = [x / far, y / far];
    sliders.forEach((slider, axis) => (slider.value = place[axis]));
    picture.style.background = `radial-gradient(circle at ${50 + 50 * place[0]}% ${50 - 50 * place[1]}%, ${colour}, #222 75%)`;
  };
  picture.addEventListener("pointermove", (event) => event.buttons && move(pointed(event)));
  picture.addEventListener("pointerdown", (event) => {
    picture.setPointerCapture(event.pointerId);
    move(pointed(event));
  });
  move(place);
  return h("div", {}, h("strong", { textContent: name }), picture, ...sliders);
}

function pointed(event) {
  const box = event.currentTarget.getBoundingClientRect();
  return [(2 * (event.clientX - box.left)) / box.width - 1, 1 - (2 * (event.clientY - box.top)) / box.height];
}
