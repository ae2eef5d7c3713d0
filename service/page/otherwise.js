// A pair separated once more by what only its photographer knows: how many lamps there are, and how it was exposed.

import { h } from "./dom.js";
import { rerun } from "./rerun.js";

/** A choice of how many lamps are asked for; wanted: as the option `lights`, which lightsOf() gives again. */
export function lampCount(wanted, onchange) {
  const texts = [["auto", "Find out"], ["1", "1"], ["2", "2"], ["3", "3"]];
  const select = h("select", { onchange }, ...texts.map(([value, textContent]) => h("option", { value, textContent })));
  select.value = String(wanted);
  return select;
}

/** Options for what is chosen there. */
export function lightsOf(select) {
  return select.value === "auto" ? {} : { lights: Number(select.value) };
}

/** A form for a separation of a job's pair with its other options as they were, and functions that show one of its fields.
 *
 * askRatio(value): fills in a ratio, where one is given. signal: ends with the view.
 */
export function otherwiseForm(job, signal) {
  const { lights = "auto", exposure_ratio = null, ...others } = job.options;
  const problems = h("div");
  const lamps = lampCount(lights);
  const ratio = h("input", { type: "number", step: "any", min: 0.001, max: 1000, value: exposure_ratio ?? "" });
  const told = () => ({ ...lightsOf(lamps), ...(ratio.value === "" ? {} : { exposure_ratio: Number(ratio.value) }) });
  const submit = rerun(job, () => ({ ...others, ...told() }), problems, signal);
  const element = h(
    "details",
    { className: "otherwise" },
    h("summary", { textContent: "Number of lamps, exposure ratio" }),
    h("p", { textContent: "The ratio is the exposure of the photograph with the flash divided by that of the other; left empty, the files or the pair itself tell it. Another job then separates the pair anew." }),
    h("form", { onsubmit: submit }, h("label", {}, "Lamps ", lamps), h("label", {}, "Exposure ratio ", ratio), h("button", { textContent: "Separate with these" })),
    problems,
  );
  const open = (field, value = field.value) => {
    element.open = true;
    field.value = value;
    field.focus();
  };
  return { element, askNumber: () => open(lamps), askRatio: (value) => open(ratio, value) };
}
