// The results of a separation: the picture, a strip for each lamp, warnings, files.

import { actionsOf } from "./actions.js";
import { fetchBytes, get, showIn } from "./api.js";
import { fullSize } from "./area.js";
import { normalsForm } from "./directions.js";
import { alarm, choice, h, isShortcut, say } from "./dom.js";
import { readExr } from "./exr.js";
import { filesOf } from "./files.js";
import { keepMix, keepSplit, keptMix, keptSplit } from "./kept.js";
import { knownForm } from "./known.js";
import { Light } from "./light.js";
import { lampMatrix, readPreset, untouched } from "./mix.js";
import { relight } from "./relight.js";
import { renderForm } from "./render.js";
import { Strip } from "./strip.js";
import { warningsOf } from "./warnings.js";

/** again(): shows them anew. */
export async function showResult(main, job, signal, again) {
  const manifest = await get(job.links.results);
  if (signal.aborted) return;
  const has = (name) => job.files.some((file) => file.name === name);
  main.className = "result";
  const picture = h("div", { className: "picture" });
  const bar = h("div", { className: "bar" });
  const foot = h("div", { className: "foot" });
  const desk = h("div", { className: "desk" });
  main.append(
    h("h1", { className: "unseen", textContent: "Light mixer" }),
    h("section", { className: "stage", "aria-label": "Picture" }, bar, picture, foot),
    h("section", { className: "controls", "aria-label": "Lamps and files" }, desk),
  );
  const views = new Views(picture, bar, foot, job, signal);
  let light = null;
  if (manifest.mix && has("preview.exr")) {
    const wait = h("p", { className: "wait", textContent: "Loading the layers …" });
    picture.append(wait);
    const came = (fraction) => (wait.textContent = `Loading the layers … ${Math.floor(100 * fraction)} %`);
    // a thumbnail that does not come, or too late, is done without
    if (has("thumbnail.jpg")) thumbnail(job, signal).then((image) => wait.before(image), console.error);
    try {
      const preview = readExr(await fetchBytes(`/jobs/${job.id}/results/preview.exr`, signal, came));
      if (signal.aborted) return;
      light = mixer(views, desk, preview, job, manifest, signal);
    } catch (error) {
      if (signal.aborted) return;
      views.add("mix", "Mix", alarm(error, again)); // where the picture would be, beside the other views
    }
  } else {
    const message = "This job has no preview.exr, which the mixer needs; its files are below.";
    desk.append(alarm({ title: "No mixer", message }));
  }
  for (const [name, text] of pictures(manifest)) if (has(name)) views.addImage(name, text);
  if (has("normals.png")) views.addNormals(manifest.options.normals);
  views.start();
  const show = {
    filled: light && ((on) => (views.choose("mix"), light.mark(on))),
    unexplained: has("residual.png") && (() => views.choose("residual.png")),
    lamps: has("gamma.png") && (() => views.choose("gamma.png")),
  };
  desk.append(
    ...warningsOf(manifest.warnings, show),
    ...(light ? [knownForm(job, manifest, light, () => views.choose("mix"), signal)] : []),
    ...(manifest.lamps.length > 1 && !has("normals.png") ? [normalsForm(job, manifest, signal)] : []),
    h("details", {}, h("summary", { textContent: "Files" }), filesOf(job, signal)),
    actionsOf(job, signal),
  );
}

/** Strips, comparison, presets and rendering; gives the picture. */
function mixer(views, desk, preview, job, manifest, signal) {
  const canvas = h("canvas", {
    id: "mix",
    tabIndex: 0,
    role: "img",
    "aria-label": "The mix. Plus and minus enlarge it, 0 shows all of it, arrow keys move it.",
  });
  views.add("mix", "Mix", canvas);
  const { step, fetchArea } = fullSize(job, manifest, preview, signal);
  const light = new Light(canvas, preview, step, fetchArea, signal);
  const basis = manifest.mix;
  const neutral = manifest.lamps.map(() => untouched());
  const matrices = (settings) => settings.map((one, lamp) => lampMatrix(basis, lamp, one));
  let alone = null; // the lamp that is shown by itself
  const current = () => {
    const soloed = strips.some((strip) => strip.solo);
    return strips.map((strip) => ({ ...strip.settings, on: strip.settings.on && (!soloed || strip.solo) }));
  };
  const draw = () => {
    const shown = alone === null ? current() : neutral.map((one, lamp) => ({ ...one, on: lamp === alone }));
    light.show(matrices(shown), matrices(neutral));
  };
  const edited = () => {
    keepMix(job.id, strips.map((strip) => strip.settings), strips.map((strip) => strip.solo));
    rendering.changed();
    views.choose("mix"); // which shows what was changed
  };
  const strips = manifest.lamps.map((lamp, index) => new Strip(lamp, index + 1, edited));
  const kept = keptMix(job.id);
  if (kept) strips.forEach((strip, index) => strip.set(kept.lamps[index], kept.solos[index]));
  manifest.lamps.forEach((_, lamp) => views.add(`lamp${lamp + 1}`, `Lamp ${lamp + 1}`, canvas));
  views.shown = (name) => {
    alone = name.startsWith("lamp") ? Number(name.slice(4)) - 1 : null;
    draw();
  };
  views.zoomable(light, comparison(light, job));
  const problems = h("div");
  const rendering = renderForm(job, current, problems, signal);
  rendering.form.addEventListener("submit", () => views.choose("mix")); // which is what is rendered
  const replace = (settings) => {
    strips.forEach((strip, index) => strip.set(settings[index]));
    edited();
  };
  desk.append(
    h("div", { className: "strips" }, ...strips.map((strip) => strip.element)),
    presets(current, replace, problems),
    rendering.form,
    problems,
  );
  draw();
  return light;
}

function comparison(light, job) {
  const slider = h("input", { type: "range", min: 0, max: 100, step: 0.5, id: "compare" });
  const compare = (percent) => {
    light.split = percent / 100;
    slider.setAttribute("aria-valuetext", `${percent} % of the picture as photographed`);
    light.draw();
  };
  slider.addEventListener("input", () => {
    keepSplit(job.id, slider.value);
    compare(slider.value);
  });
  slider.value = keptSplit(job.id); // after its limits
  compare(slider.value);
  return h("label", { className: "compare" }, h("span", { textContent: "Before" }), slider, h("span", { textContent: "After" }));
}

function presets(current, replace, problems) {
  const save = () => {
    const text = `${JSON.stringify({ lamps: current() }, null, 2)}\n`;
    const url = URL.createObjectURL(new Blob([text], { type: "application/json" }));
    h("a", { href: url, download: "mix.json" }).click();
    setTimeout(() => URL.revokeObjectURL(url), 1000);
  };
  const load = h("input", { type: "file", accept: ".json,application/json", className: "unseen", "aria-label": "Load preset" });
  load.addEventListener("change", async () => {
    problems.replaceChildren();
    try {
      replace(readPreset(await load.files[0].text(), current().length));
      say("The preset is loaded.");
    } catch (error) {
      problems.append(alarm({ title: "No preset", message: error.message }));
    }
    load.value = "";
  });
  return h(
    "p",
    { className: "row" },
    h("button", { type: "button", textContent: "Reset", onclick: () => replace(current().map(untouched)) }),
    h("button", { type: "button", textContent: "Save preset", onclick: save }),
    h("label", { className: "button" }, load, "Load preset"),
  );
}

function pictures(manifest) {
  return [
    ["white_balanced_1.jpg", "White balanced"],
    ["response.jpg", "Other camera"],
    ["gamma.png", manifest.lamps.length > 1 ? "Why these lamps" : "Why this lamp"],
    ["residual.png", "Unexplained"],
  ];
}

async function thumbnail(job, signal) {
  const image = h("img", { alt: "", className: "early" });
  await showIn(image, `/jobs/${job.id}/results/thumbnail.jpg`, signal);
  return image;
}

/** The pictures that can be looked at, one at a time. */
class Views {
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

function moveBy(light) {
  const { canvas } = light;
  const fingers = new Map();
  const apart = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    light.enlarge(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
  }, { passive: false });
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) fingers.delete(event.pointerId); // a menu may have taken its end
    const held = fingers.get(event.pointerId);
    if (!held) return;
    const before = fingers.size === 2 ? apart() : null;
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (before) light.enlarge(apart() / before, event.offsetX, event.offsetY);
    else light.move(event.offsetX - held[0], event.offsetY - held[1]);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
  const keys = {
    "+": () => light.enlarge(1.5),
    "-": () => light.enlarge(1 / 1.5),
    0: () => light.zoom(null),
    1: () => light.zoom(light.step),
    ArrowLeft: () => light.move(40, 0),
    ArrowRight: () => light.move(-40, 0),
    ArrowUp: () => light.move(0, 40),
    ArrowDown: () => light.move(0, -40),
  };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || isShortcut(event)) return;
    event.preventDefault();
    keys[event.key]();
  });
}
