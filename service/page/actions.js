// What can be done with a job that has ended: run it again, its photographs swapped where they are the wrong way round, or delete it.

import { remove, sender } from "./api.js";
import { h, single } from "./dom.js";
import { keepMix, keptMix } from "./kept.js";
import { untouched } from "./mix.js";
import { goTo, tellProblem } from "./notes.js";

const SWAPPED = "urn:lightlayers:problem:swapped-pair";
const UNREADABLE = "urn:lightlayers:problem:unreadable-image";

/** Whether a job that has ended may come to another end: photographs that cannot be read stay as they are. */
export function mayRunAgain(job) {
  return job.state !== "expired" && !(job.inputs && job.error?.type === UNREADABLE);
}

export function actionsOf(job, signal) {
  const problems = h("div");
  const send = sender();
  const attempt = (work) =>
    single(async () => {
      problems.replaceChildren();
      try {
        await work();
      } catch (error) {
        tellProblem(error, problems, signal);
      }
    });
  const swapped = job.error?.type === SWAPPED;
  const again = async () => goTo(await runAgain(send, job, swapped), signal);
  const gone = async () => {
    if ((await deleteJob(job)) && !signal.aborted) location.hash = "#/jobs";
  };
  const row = h("p", { className: "row actions" });
  if (job.options.kind === "mix") row.append(mixerOf(job.options));
  else if (mayRunAgain(job)) row.append(button(swapped ? "Swap and run again" : "Run again", attempt(again)));
  row.append(button("Delete", attempt(gone)), h("a", { className: "button", href: "#/", textContent: "Add two photographs" }));
  return h("div", {}, row, problems);
}

/** A way to the mixer, which shows this mix unless it was left with another one. */
function mixerOf({ of, mix }) {
  const lamps = mix.lamps.map((lamp) => ({ ...untouched(), ...lamp }));
  const show = () => keptMix(of) ?? keepMix(of, lamps, lamps.map(() => false));
  return h("a", { className: "button", href: `#/jobs/${of}`, textContent: "Back to the mixer", onclick: show });
}

/** Delete a job if the user agrees to that; whether it is gone. */
export async function deleteJob(job) {
  if (!confirm("Delete this job with its photographs and results? They cannot be brought back.")) return false;
  await remove(`/jobs/${job.id}`).catch((error) => {
    if (error.status !== 404) throw error; // else it is gone: another tab was first, or an answer got lost
  });
  return true;
}

/** Another job like this one, its photographs swapped or as they are; a camera that took no pair takes one. */
function runAgain(send, job, swapped) {
  if (job.inputs) return send(`/jobs/${job.id}/rerun`, swapped ? { swapped } : {});
  return send(job.options.kind ? "/calibrations" : "/jobs", { capture: job.capture, options: job.options });
}

function button(textContent, onclick) {
  return h("button", { type: "button", textContent, onclick });
}
