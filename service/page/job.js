// One job: how far it is, why it failed, or its results.

import { alarm, entitle, h, say } from "./dom.js";
import { actionsOf, mayRunAgain } from "./actions.js";
import { get } from "./api.js";
import { filesOf } from "./files.js";
import { otherwiseForm } from "./otherwise.js";
import { progressOf } from "./progress.js";
import { showResult } from "./result.js";
import { warningsOf } from "./warnings.js";
import { watch } from "./watch.js";
import { kindOf, stateOf, titleOf } from "./words.js";

/** again(): shows it anew. */
export async function showJob(main, id, signal, again) {
  const clear = () => {
    if (main.contains(document.activeElement)) main.focus(); // else the keyboard were lost with the button it was at
    main.replaceChildren();
  };
  const job = await watch(id, signal, progressOf(main, id, signal)).finally(() => signal.aborted || clear());
  if (!job) return;
  entitle(titleOf(job));
  if (job.state === "succeeded" && !job.options.kind) {
    await showResult(main, job, signal, again);
  } else {
    const parts = job.state === "succeeded" ? [...(await toldOf(job)), filesOf(job, signal)] : [reasonOf(job)];
    if (job.inputs && !job.options.kind && mayRunAgain(job)) parts.push(otherwiseForm(job, signal).element);
    if (signal.aborted) return;
    main.append(h("h1", { textContent: kindOf(job) }), ...parts, actionsOf(job, signal));
  }
  if (!signal.aborted) say(`${kindOf(job)}: ${stateOf(job)}`);
}

/** What the manifest of a calibration or a mix warns of. */
async function toldOf(job) {
  const { warnings } = await get(job.links.results);
  return warningsOf(warnings, {});
}

function reasonOf(job) {
  const title = job.error?.title ?? stateOf(job);
  const advice = job.error?.retryable ? " The same again may well work." : "";
  const ended = job.state === "expired" ? "The job's time is over; its files are being removed." : "The job was stopped before its end.";
  return alarm({ title, message: (job.error?.detail ?? ended) + advice });
}
