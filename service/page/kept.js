// The mix of each job as it was left, for as long as the tab is open.

const nameOf = (id) => `lightlayers-mix-${id}`;

/** Keep a mix of a job: the settings of its lamps, and which are soloed. */
export function keepMix(id, lamps, solos) {
  sessionStorage.setItem(nameOf(id), JSON.stringify({ lamps, solos }));
}

/** The mix that was kept of a job; null where there is none. */
export function keptMix(id) {
  return JSON.parse(sessionStorage.getItem(nameOf(id)));
}
