// The mix as a picture of full size, made by a job of its own.

import { sender } from "./api.js";
import { bytes, h, hold, say, single } from "./dom.js";
import { save } from "./files.js";
import { tellProblem } from "./notes.js";
import { watch } from "./watch.js";

const FORMATS = [["jpeg", "JPEG"], ["tiff", "TIFF, 16 bits"], ["exr", "EXR, linear"]];

/** The form, and what is to be called with every change of the mix. current(): its settings. */
export function renderForm(job, current, problems, signal) {
  const send = sender();
  const format = h("select", { "aria-label": "Format" }, ...FORMATS.map(([value, textContent]) => h("option", { value, textContent })));
  const button = h("button", { className: "main", textContent: "Render full size" });
  const bar = h("progress", { max: 1, hidden: true, "aria-label": "Rendering" });
  const done = h("div", { className: "rendered" });
  let compare = () => {};
  const render = async () => {
    const lamps = current();
    const made = await send(`/jobs/${job.id}/mix`, { lamps, format: format.value });
    const ended = await watch(made.id, signal, (now) => (bar.value = now.fraction), made);
    if (!ended) return;
    const file = downloadOf(ended, problems, signal);
    const older = h("p", {}, "The mix has changed since: ", h("a", { href: `#/jobs/${ended.id}`, textContent: `${file.name} as it was` }));
    compare = () => {
      older.hidden = JSON.stringify(lamps) === JSON.stringify(current());
      file.button.hidden = !older.hidden;
    };
    compare();
    done.append(file.button, older);
    say("The picture of full size is ready.");
  };
  const submit = single(async () => {
    problems.replaceChildren();
    done.replaceChildren();
    hold(button, true);
    bar.hidden = false;
    bar.removeAttribute("value");
    await render().catch((error) => tellProblem(error, problems, signal));
    hold(button, false);
    bar.hidden = true;
  });
  const form = h("form", { className: "row render", onsubmit: submit }, format, button, bar, done);
  return { form, changed: () => compare() };
}

/** The picture of a job that has ended: its name, and a button that saves it. */
function downloadOf(job, problems, signal) {
  if (job.state !== "succeeded") {
    const error = new Error(job.error?.detail ?? "The rendering was stopped.");
    error.title = job.error?.title;
    throw error;
  }
  const { name, size, href } = job.files.find((one) => one.name.startsWith("mix."));
  const button = h("button", { type: "button", textContent: `Download ${name} (${bytes(size)})`, onclick: save(href, name, problems, signal) });
  return { name, button };
}
