// The mix as a picture of full size, made by a job of its own.

import { sender } from "./api.js";
import { alarm, bytes, h, say } from "./dom.js";
import { save } from "./files.js";
import { watch } from "./watch.js";

const FORMATS = [["jpeg", "JPEG"], ["tiff", "TIFF, 16 bits"], ["exr", "EXR, linear"]];

export function renderForm(job, current, problems, signal) {
  const send = sender();
  const format = h("select", { "aria-label": "Format" }, ...FORMATS.map(([value, textContent]) => h("option", { value, textContent })));
  const button = h("button", { className: "main", textContent: "Render full size" });
  const bar = h("progress", { max: 1, hidden: true, "aria-label": "Rendering" });
  const done = h("span", { className: "rendered" });
  const form = h("form", { className: "row render" }, format, button, bar, done);
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    problems.replaceChildren();
    done.replaceChildren();
    button.disabled = true;
    bar.hidden = false;
    bar.removeAttribute("value");
    try {
      const made = await send(`/jobs/${job.id}/mix`, { lamps: current(), format: format.value });
      const ended = await watch(made.id, signal, (now) => (bar.value = now.fraction));
      if (ended) finish(ended, done, problems);
    } catch (error) {
      problems.append(alarm(error));
    }
    button.disabled = false;
    bar.hidden = true;
  });
  return form;
}

function finish(job, done, problems) {
  if (job.state !== "succeeded") {
    const error = new Error(job.error?.detail ?? "The rendering was stopped.");
    error.title = job.error?.title;
    throw error;
  }
  const file = job.files.find((one) => one.name.startsWith("mix."));
  done.append(
    h("button", {
      type: "button",
      textContent: `Download ${file.name} (${bytes(file.size)})`,
      onclick: save(file.href, file.name, problems),
    }),
  );
  say("The picture of full size is ready.");
}
