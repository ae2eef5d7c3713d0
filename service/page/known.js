// Lamps that are pinned or forbidden by places in the picture: another job takes them into account.

import { alarm, choice, h, say } from "./dom.js";
import { keepKnown, keptKnown } from "./kept.js";
import { rerun } from "./rerun.js";
import { Spots, onTap } from "./spots.js";

const RADIUS = 0.015; // of a new circle, as a share of the longer side
const KINDS = [
  ["pinned_lamps", "One lamp alone: pin", "Pinned lamp"],
  ["forbidden_lamps", "No lamp: forbid", "Forbidden lamp"],
];
const NONE = { title: "No place is marked", message: "Click a place in the picture first." };

/** A form that marks places in the picture of a light, and separates the pair of a job again.
 *
 * look(): has the picture shown. signal: ends with the view.
 */
export function knownForm(job, manifest, light, look, signal) {
  const { width, height } = manifest.inputs.no_flash;
  const size = [width, height];
  const before = Object.fromEntries(KINDS.map(([kind]) => [kind, job.options[kind] ?? []]));
  const left = keptKnown(job.id);
  const known = left ?? structuredClone(before);
  const problems = h("div");
  const list = h("ul");
  const spots = new Spots(light, Math.floor(width / light.size[0])); // of a preview, squares that are not whole are left out
  let kind = KINDS[0][0];

  const changed = () => {
    keepKnown(job.id, known);
    show();
  };
  const show = () => {
    const circles = KINDS.flatMap(([of]) => known[of].map((lamp, index) => ({ ...lamp, number: index + 1, forbidden: of !== KINDS[0][0] })));
    spots.show(element.open ? circles.filter(({ radius }) => radius) : []);
  };
  const rows = () => {
    const all = KINDS.flatMap(([of, , name]) => known[of].map((lamp, index) => row(`${name} ${index + 1}`, lamp, size, changed, () => drop(of, index))));
    list.replaceChildren(...all);
  };
  const drop = (of, index) => {
    known[of].splice(index, 1);
    rows();
    changed();
    middle.focus(); // else the keyboard were lost with the button
  };
  const see = () => light.canvas.isConnected || look(); // what is not shown has no middle
  const mark = (place) => {
    if (place.some((value, axis) => value < 0 || value >= size[axis])) return; // beside the photograph
    const [x, y] = place.map(Math.floor);
    known[kind].push({ x, y, radius: Math.max(4, Math.round(RADIUS * Math.max(...size))) });
    problems.replaceChildren();
    rows();
    changed();
    say(`${KINDS.find(([of]) => of === kind)[2]} ${known[kind].length} is marked at ${x}, ${y}.`);
  };
  const middle = h("button", { type: "button", textContent: "Mark the middle", "aria-label": "Mark the middle of the picture", onclick: () => (see(), mark(spots.at())) });
  const told = () => {
    if (KINDS.some(([of]) => known[of].length || before[of].length)) return { ...job.options, ...known };
    problems.append(alarm(NONE));
    return null;
  };
  const submit = rerun(job, told, problems, signal);
  const element = h(
    "details",
    { className: "known", open: left !== null },
    h("summary", { textContent: "Pin or forbid lamps" }),
    h("p", { textContent: "Click a place in the picture. One that a lamp lights alone pins that lamp; one in a light that is no lamp forbids that. Another job then separates the pair anew." }),
    choice("What lights the place that you click", KINDS, kind, (chosen) => (kind = chosen)),
    h("form", { onsubmit: submit }, list, h("p", { className: "row" }, middle, h("button", { textContent: "Separate again" }))),
    problems,
  );
  element.addEventListener("toggle", () => {
    light.canvas.classList.toggle("pointed", element.open);
    if (element.open) see();
    show();
  });
  onTap(light.canvas, (...point) => element.open && mark(spots.at(point)));
  rows();
  return element;
}

/** A line of the list: a circle with its numbers, which changed() is called for, or a spectrum. */
function row(name, lamp, size, changed, remove) {
  const number = (label, key, min, max) =>
    h(
      "label",
      {},
      label,
      h("input", {
        type: "number",
        required: true,
        step: "any",
        min: Math.min(min, lamp[key]), // the service takes parts of pixels, too
        max: Math.max(max, lamp[key]),
        value: lamp[key],
        "aria-label": `${name}: ${label}`,
        oninput: ({ target }) => {
          if (!target.validity.valid) return; // the form is not sent so either
          lamp[key] = Number(target.value);
          changed();
        },
      }),
    );
  const numbers = lamp.radius
    ? [number("x", "x", 0, size[0] - 1), number("y", "y", 0, size[1] - 1), number("radius", "radius", 1, Math.max(...size))]
    : [h("span", { textContent: typeof lamp === "string" ? lamp : "a spectrum" })];
  return h(
    "li",
    {},
    h("strong", { textContent: name }),
    h("button", { type: "button", className: "link", textContent: "Remove", "aria-label": `Remove ${name.toLowerCase()}`, onclick: remove }),
    h("span", { className: "numbers" }, ...numbers),
  );
}
