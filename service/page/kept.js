// The mix of each job, and what was marked in its picture, as they were left, for as long as the tab is open.

import { keep, kept } from "./tab.js";

const nameOf = (id) => `lightlayers-mix-${id}`;
const splitOf = (id) => `lightlayers-split-${id}`;
const knownOf = (id) => `lightlayers-known-${id}`;

/** Keep a mix of a job: the settings of its lamps, and which are soloed. */
export function keepMix(id, lamps, solos) {
  keep(nameOf(id), JSON.stringify({ lamps, solos }));
}

/** The mix that was kept of a job; null where there is none. */
export function keptMix(id) {
  return JSON.parse(kept(nameOf(id)));
}

/** Keep how much of a job's picture is shown as photographed, in percent from the left. */
export function keepSplit(id, percent) {
  keep(splitOf(id), String(percent));
}

/** The percentage that was kept of a job; 0 where there is none. */
export function keptSplit(id) {
  return Number(kept(splitOf(id)));
}

/** Keep which lamps are to be pinned and forbidden in another job on the pair of this one. */
export function keepKnown(id, known) {
  keep(knownOf(id), JSON.stringify(known));
}

/** Those that were kept of a job; null where there are none. */
export function keptKnown(id) {
  return JSON.parse(kept(knownOf(id)));
}
