// A job's pair asked for once more, with other options.

import { sender } from "./api.js";
import { single } from "./dom.js";
import { goTo, tellProblem } from "./notes.js";

/** What handles the form that asks: it makes another job and goes there, or tells the problem.
 *
 * optionsOf(): all options of that job; null where something lacks, which it has told. problems: an
 * element for them. signal: ends with the view.
 */
export function rerun(job, optionsOf, problems, signal) {
  const send = sender();
  return single(async () => {
    problems.replaceChildren();
    const options = optionsOf();
    if (!options) return;
    try {
      goTo(await send(`/jobs/${job.id}/rerun`, { options }), signal);
    } catch (error) {
      tellProblem(error, problems, signal);
    }
  });
}
