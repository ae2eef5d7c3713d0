// The pictures of a result, of which one at a time is looked at.

import { fetchBytes, showIn } from "./api.js";
import { alarm, choice, h } from "./dom.js";
import { moveBy } from "./moving.js";
import { relight } from "./relight.js";

/** place: where the picture is. bar: where it is chosen. foot: where it is compared. signal: ends with the view. */
export class Views {
  constructor(place, bar, foot, job, signal) {
    this.shown = () => {};
    this._place = place;
    this._bar = bar;
    this._foot = foot;
    this._job = job;
    this._signal = signal;
    this._views = new Map();
    this._light = null;
    this._told = null; // why a picture did not come
  }

  add(name, text, element, start = () => {}) {
    this._views.set(name, { text, element, start });
  }

  addImage(name, text) {
    const image = h("img", { className: "plain", alt: text });
    const path = this._path(name);
    this.add(name, text, image, async () => {
      await showIn(image, path, this._signal);
      await image.decode().catch(() => {
        throw new Error("This browser cannot show the picture; it is among the files.");
      });
    });
  }

  addNormals(convention) {
    const canvas = h("canvas", {
      id: "normals",
      tabIndex: 0,
      role: "img",
      "aria-label": "The normals under a light that follows the pointer or the arrow keys.",
    });
    this.add("normals.png", "Normals", canvas, async () => {
      const picture = new Blob([await fetchBytes(this._path("normals.png"), this._signal)]);
      await relight(canvas, picture, convention, this._signal);
    });
  }

  /** Let a picture be enlarged and moved by pointer and keys. */
  zoomable(light, comparison) {
    this._light = light;
    const button = (text, label, work) => h("button", { type: "button", textContent: text, "aria-label": label, onclick: work });
    this._zoom = h(
      "div",
      { className: "zoom" },
      button("Fit", "Fit: show all of the picture", () => light.zoom(null)),
      button("1:1", "1:1, pixel by pixel", () => light.zoom(light.step)),
      button("−", "Smaller", () => light.enlarge(1 / 1.5)),
      button("+", "Larger", () => light.enlarge(1.5)),
    );
    this._comparison = comparison;
    moveBy(light);
  }

  start() {
    const names = [...this._views].map(([name, { text }]) => [name, text]);
    if (!names.length) return;
    this._choice = choice("View", names, names[0][0], (name) => this._show(name));
    this._bar.append(this._choice);
    if (this._zoom) this._bar.append(this._zoom);
    if (this._comparison) this._foot.append(this._comparison);
    this._show(names[0][0]);
  }

  choose(name) {
    this._choice.querySelector(`input[value="${name}"]`).checked = true;
    this._show(name);
  }

  _show(name) {
    const view = this._views.get(name);
    const mixes = view.element === this._light?.canvas;
    if (view.element.parentNode !== this._place) this._place.replaceChildren(view.element);
    this._told?.remove(); // it is tried again
    const { start } = view;
    view.start = () => {};
    Promise.resolve(start()).catch((error) => {
      view.start = start; // looked at again, it is tried again
      if (!this._place.contains(view.element)) return;
      this._told = alarm(error, () => {
        this._choice.querySelector(":checked").focus(); // else the keyboard were lost with the button
        this._show(name);
      });
      this._place.append(this._told);
    });
    for (const part of [this._zoom, this._comparison]) if (part) part.hidden = !mixes;
    if (mixes) this.shown(name);
  }

  _path(name) {
    return `/jobs/${this._job.id}/results/${name}`;
  }
}
