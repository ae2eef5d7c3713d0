// One job: how far it is, why it failed, or its results.

import { get, post } from "./api.js";
import { alarm, h, say } from "./dom.js";
import { kindOf, stateOf } from "./jobs.js";
import { showResult } from "./result.js";

const LOOK_MS = 400;
const ENDED = ["succeeded", "failed", "canceled", "expired"];
const STAGES = {
  capture: "Take both photographs",
  decode: "Read the photographs",
  align: "Lay them on each other",
  lamps: "Find the lamps",
  layers: "Separate their light",
  encode: "Write the results",
  calibrate: "Calibrate",
  mix: "Mix the layers",
};

export async function showJob(main, id, signal) {
  const job = await watch(id, signal, progressOf(main, id));
  if (!job) return;
  main.replaceChildren();
  if (job.state === "succeeded" && !job.options.kind) {
    await showResult(main, job, signal);
  } else if (job.state === "succeeded") {
    await showFiles(main, job);
  } else {
    main.append(h("h1", { textContent: kindOf(job) }));
    const title = job.error?.title ?? stateOf(job);
    main.append(alarm({ title, message: job.error?.detail ?? "The job was stopped." }));
    main.append(h("p", {}, h("a", { className: "button", href: "#/", textContent: "Add two photographs" })));
  }
  say(`${kindOf(job)}: ${stateOf(job)}`);
}

/** Look at a job until it ends; null where the user has left. */
export async function watch(id, signal, show) {
  for (;;) {
    const job = await get(`/jobs/${encodeURIComponent(id)}`);
    if (signal.aborted) return null;
    if (ENDED.includes(job.state)) return job;
    show(job);
    await new Promise((resolve) => setTimeout(resolve, LOOK_MS));
    if (signal.aborted) return null;
  }
}

function stagesOf(job) {
  if (job.options.kind === "mix") return ["mix"];
  const both = ["decode", "align"];
  const rest = job.options.kind ? ["calibrate"] : ["lamps", "layers", "encode"];
  return [...(job.capture ? ["capture"] : []), ...both, ...rest];
}

function progressOf(main, id) {
  const heading = h("h1", { textContent: "…" });
  const steps = h("ol", { className: "steps" });
  const cancel = h("button", {
    type: "button",
    textContent: "Cancel",
    onclick: () => post(`/jobs/${id}/cancel`, {}),
  });
  main.append(heading, steps, h("p", {}, cancel));
  let told = "";
  return (job) => {
    const stages = stagesOf(job);
    const place = job.position ? `, place ${job.position} in the queue` : "";
    const at = stages.indexOf(job.stage);
    heading.textContent = `${kindOf(job)}: ${stateOf(job).toLowerCase()}${place}`;
    steps.replaceChildren(
      ...stages.map((stage, index) => {
        const done = index < at ? 1 : index === at ? job.fraction : 0;
        const label = STAGES[stage];
        const step = h("li", { className: index < at ? "done" : "" }, h("span", { textContent: label }));
        step.append(h("progress", { max: 1, value: done, "aria-label": label }));
        if (index === at) step.setAttribute("aria-current", "step");
        return step;
      }),
    );
    const words = STAGES[job.stage] ?? heading.textContent;
    if (words !== told) say((told = words));
  };
}

async function showFiles(main, job) {
  const { filesOf } = await import("./files.js");
  main.append(h("h1", { textContent: kindOf(job) }), filesOf(job));
}
