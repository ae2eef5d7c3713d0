// The mixer of a result: strips, comparison, presets and rendering.

import { fullSize } from "./area.js";
import { alarm, h, say } from "./dom.js";
import { keepMix, keepSplit, keptMix, keptSplit } from "./kept.js";
import { Light } from "./light.js";
import { lampMatrix, readPreset, untouched } from "./mix.js";
import { renderForm } from "./render.js";
import { Strip } from "./strip.js";

/** Put the mix among the views, and its controls onto the desk; gives the picture.
 *
 * preview: of readExr. signal: ends with the view.
 */
export function mixer(views, desk, preview, job, manifest, signal) {
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
