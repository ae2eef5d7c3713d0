// The channel strip of one lamp.

import { choice, h, toggle } from "./dom.js";
import { TINT_PER_DUV, gelOf, hexOf, untouched } from "./mix.js";

const MIRED = [1e6 / 12000, 1e6 / 1500]; // the ends of the slider, which feels even in mired
const DAYLIGHT = 6504;

/** A strip; lamp: its entry in the manifest. changed() is called with every change that its user makes. */
export class Strip {
  constructor(lamp, number, changed) {
    this.settings = untouched();
    this.solo = false;
    this.name = `Lamp ${number}`;
    this._lamp = lamp;
    this._changed = changed;
    this.element = h("fieldset", { className: "strip" });
    this._build();
  }

  /** Take other settings, of a preset. */
  set(settings, solo = false) {
    this.settings = settings;
    this.solo = solo;
    this._build();
  }

  _build() {
    const { settings } = this;
    const colour = h("div", { className: "colour" });
    this.element.replaceChildren(
      h("legend", { className: "unseen", textContent: this.name }),
      this._head(),
      slider("Exposure", [-5, 5, 0.05], settings.ev, (value) => `${signed(value.toFixed(2))} EV`, (value) => {
        this._set({ ev: value });
      }, "even"),
      choice(
        `Colour of ${this.name}`,
        [["as shot", "As shot"], ["neutral", "Neutral"], ["kelvin", "Kelvin"], ["gel", "Gel"]],
        this._mode(),
        (mode) => {
          this._enter(mode);
          colour.replaceChildren(...this._controls());
        },
      ),
      colour,
    );
    colour.append(...this._controls());
    this._dim();
  }

  _head() {
    const lamp = this._lamp;
    const kelvin = lamp.cct_k ? ` · ${lamp.cct_k} K` : "";
    const chip = h("span", { className: "chip", "aria-hidden": "true" });
    chip.style.background = lamp.srgb;
    const on = toggle("On", `${this.name} on`, this.settings.on, (state) => {
      on.setAttribute("aria-pressed", String(state));
      this._set({ on: state });
    });
    const solo = toggle("Solo", `Solo ${this.name}`, this.solo, (state) => {
      solo.setAttribute("aria-pressed", String(state));
      this.solo = state;
      this._changed();
    });
    return h(
      "div",
      { className: "head" },
      chip,
      h(
        "div",
        { className: "who" },
        h("strong", { textContent: this.name }),
        h("span", { textContent: `${lamp.family}${kelvin}` }),
      ),
      on,
      solo,
    );
  }

  _mode() {
    const { neutral, temperature_k, rgb } = this.settings;
    if (temperature_k !== null) return "kelvin";
    if (rgb.some((value) => value !== 1)) return "gel";
    return neutral ? "neutral" : "as shot";
  }

  _enter(mode) {
    const colour = { neutral: false, temperature_k: null, tint: 0, rgb: [1, 1, 1] };
    if (mode === "neutral") colour.neutral = true;
    if (mode === "kelvin") {
      const { cct_k: kelvin, duv } = this._lamp;
      const tint = Math.round(TINT_PER_DUV * (duv ?? 0));
      colour.temperature_k = Math.min(12000, Math.max(1500, kelvin ?? DAYLIGHT));
      colour.tint = Math.min(150, Math.max(-150, tint));
    }
    if (mode === "gel") Object.assign(colour, { neutral: true, rgb: gelOf("#ffb46b") });
    this._set(colour);
  }

  _controls() {
    const { settings } = this;
    if (this._mode() === "kelvin") {
      const ends = [-MIRED[1], -MIRED[0], 1];
      return [
        slider("Temperature", ends, -1e6 / settings.temperature_k, (value) => `${kelvin(value)} K`, (value) => {
          this._set({ temperature_k: kelvin(value) });
        }, "warm"),
        slider("Tint", [-150, 150, 1], settings.tint, (value) => signed(String(value)), (value) => {
          this._set({ tint: value });
        }, "tint"),
      ];
    }
    if (this._mode() === "gel") {
      const picker = h("input", {
        type: "color",
        value: hexOf(settings.rgb),
        oninput: () => this._set({ rgb: gelOf(picker.value) }),
      });
      return [h("label", { className: "picker" }, "Colour of the gel ", picker)];
    }
    return [];
  }

  _set(values) {
    this.settings = { ...this.settings, ...values };
    this._dim();
    this._changed();
  }

  _dim() {
    this.element.classList.toggle("dark", !this.settings.on);
  }
}

/** A slider with its value in words; a double click takes it back to the middle. */
function slider(label, [min, max, step], value, words, change, look = "") {
  const shown = h("span", { className: "value", textContent: words(value), "aria-hidden": "true" });
  const input = h("input", { type: "range", min, max, step, className: look, "aria-label": label });
  input.value = value; // after its limits
  input.setAttribute("aria-valuetext", words(value));
  input.addEventListener("input", () => {
    const number = Number(input.value);
    shown.textContent = words(number);
    input.setAttribute("aria-valuetext", words(number));
    change(number);
  });
  if (min === -max) {
    input.addEventListener("dblclick", () => {
      input.value = 0;
      input.dispatchEvent(new Event("input"));
    });
  }
  // no <label>, which would be one of the output
  const title = h("span", { textContent: label, "aria-hidden": "true" });
  return h("div", { className: "slider" }, title, shown, input);
}

function kelvin(value) {
  return Math.round(-1e5 / value) * 10;
}

function signed(text) {
  return Number(text) > 0 ? `+${text}` : text.replace("-", "−");
}
