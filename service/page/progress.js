// How far a job is, stage by stage, and what it asks its operator to do.

import { hereAt, post } from "./api.js";
import { entitle, h, hold, say, single } from "./dom.js";
import { tellProblem } from "./notes.js";
import { kindOf, stateOf, titleOf } from "./words.js";

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

/** Gives a function that shows a job, and whether the service is away just now. signal: ends with the view. */
export function progressOf(main, id, signal) {
  const heading = h("h1");
  const when = h("p", { className: "lead" });
  const request = h("div");
  const problems = h("div");
  const steps = h("ol", { className: "steps" });
  const ask = (path) =>
    single(async () => {
      problems.replaceChildren();
      await post(path, {}).catch((error) => tellProblem(error, problems, signal));
    });
  const cancel = h("button", { type: "button", textContent: "Cancel", onclick: ask(`/jobs/${id}/cancel`) });
  const parts = [heading, when, request, steps, h("p", {}, cancel), problems];
  let told = "";
  let asked = "";
  return (job, away) => {
    if (!heading.isConnected) main.append(...parts); // only now is it known that there is such a job
    heading.textContent = `${kindOf(job)}: ${stateOf(job).toLowerCase()}`;
    entitle(titleOf(job));
    when.textContent = away ? "The service does not answer just now; it is asked again." : whenOf(job);
    hold(cancel, job.state === "canceling");
    steps.replaceChildren(...stepsOf(job));
    const link = job.operator ? job.links.confirm : ""; // of this request alone, whatever its words
    const held = request.contains(document.activeElement); // else its keyboard were lost with the button
    if (link !== asked) request.replaceChildren(...requestOf(job, ask));
    if (link !== asked && held) main.focus();
    asked = link;
    const words = job.operator?.request || STAGES[job.stage] || heading.textContent;
    if (words !== told) say((told = words));
  };
}

function stepsOf(job) {
  const stages = stagesOf(job);
  const at = stages.indexOf(job.stage);
  return stages.map((stage, index) => {
    const done = index < at ? 1 : index === at ? job.fraction : 0;
    const label = STAGES[stage];
    const step = h("li", { className: index < at ? "done" : "" }, h("span", { textContent: label }));
    step.append(h("progress", { max: 1, value: done, "aria-label": label }));
    if (index === at) step.setAttribute("aria-current", "step");
    return step;
  });
}

function stagesOf(job) {
  if (job.options.kind === "mix") return ["mix"];
  const both = ["decode", "align"];
  const rest = job.options.kind ? ["calibrate"] : ["lamps", "layers", "encode"];
  return [...(job.capture ? ["capture"] : []), ...both, ...rest];
}

function whenOf(job) {
  const parts = [];
  if (job.position) parts.push(`Place ${job.position} in the queue`);
  const tries = job.attempt - (job.capture && job.inputs ? 1 : 0); // the first start took the pair, and did not fail
  if (tries > 1) parts.push(`Attempt ${tries}`);
  const seconds = job.eta ? (hereAt(job.eta) - Date.now()) / 1000 : 0;
  if (seconds > 90) parts.push(`about ${Math.round(seconds / 60)} minutes left`);
  else if (seconds > 5) parts.push(`about ${Math.ceil(seconds / 5) * 5} seconds left`);
  return parts.join(" · ");
}

/** What somebody is asked to do at the camera, with a button for when it is done. */
function requestOf(job, ask) {
  if (!job.operator) return [];
  const until = job.operator.until && hereAt(job.operator.until).toLocaleTimeString([], { timeStyle: "short" });
  return [
    h(
      "section",
      { className: "request", "aria-label": "What you are asked to do" },
      h("strong", { textContent: job.operator.request }),
      until ? h("p", { textContent: `The job waits until ${until}.` }) : null,
      h("button", { type: "button", className: "main", textContent: "Confirm", onclick: ask(job.links.confirm) }),
    ),
  ];
}
