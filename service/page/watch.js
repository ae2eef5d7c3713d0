// A job from its first moment to its last: by its events, and by asking where those do not come or another window is used.

import { get } from "./api.js";
import { isUsed, pause } from "./dom.js";
import { follow } from "./events.js";

const ASK_MS = 1000;
const HIDDEN_MS = 5000; // in a tab of which nobody sees more than the title
export const AWAY = [0, 502, 503, 504]; // no answer, or one of a proxy or service that is about to come back
export const ENDED = ["succeeded", "failed", "canceled", "expired"];

/** Watch a job until it ends, and give it back; null where the user has left.
 *
 * show(job, away): the job as it is known, and whether the service is away just now. job: as it is known
 * before; without one, a service that is away at first throws its Problem.
 */
export async function watch(id, signal, show, job = null) {
  const path = `/jobs/${encodeURIComponent(id)}`;
  let streams = true;
  const told = (now) => {
    job = now;
    if (!signal.aborted && !ENDED.includes(job.state)) show(job, false);
  };
  while (!signal.aborted) {
    try {
      told(await get(path));
      if (streams && isUsed() && !ENDED.includes(job.state)) streams = await follow(`${path}/events`, signal, (now) => now.state && told(now));
      if (ENDED.includes(job.state)) break;
    } catch (error) {
      if (signal.aborted) break;
      if (!job || !AWAY.includes(error.status)) throw error;
      show(job, true);
    }
    await pause(document.hidden ? HIDDEN_MS : ASK_MS, signal);
  }
  return signal.aborted ? null : job;
}
