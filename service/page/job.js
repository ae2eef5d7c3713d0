// One job: how far it is, why it failed, or its results.

import { alarm, entitle, h, say } from "./dom.js";
import { actionsOf } from "./actions.js";
import { filesOf } from "./files.js";
import { progressOf } from "./progress.js";
import { showResult } from "./result.js";
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
    main.append(h("h1", { textContent: kindOf(job) }), job.state === "succeeded" ? filesOf(job, signal) : reasonOf(job), actionsOf(job, signal));
  }
  if (!signal.aborted) say(`${kindOf(job)}: ${stateOf(job)}`);
}

function reasonOf(job) {
  const title = job.error?.title ?? stateOf(job);
  const advice = job.error?.retryable ? " The same again may well work." : "";
  const ended = job.state === "expired" ? "The job's time is over; its files are being removed." : "The job was stopped before its end.";
  return alarm({ title, message: (job.error?.detail ?? ended) + advice });
}
