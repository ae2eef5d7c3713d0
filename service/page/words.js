// What a job is, and how it is, in words.

const STATES = {
  queued: "Waits",
  waiting_for_operator: "Waits for you",
  running: "Runs",
  canceling: "Stops",
  succeeded: "Done",
  failed: "Failed",
  canceled: "Canceled",
  expired: "Expired",
};

/** Its state in a word. */
export function stateOf(job) {
  return STATES[job.state] ?? job.state;
}

/** What it does, in a word. */
export function kindOf(job) {
  const { kind } = job.options;
  if (kind === "mix") return "Full-size mix";
  return kind ? `Calibration of ${kind === "lamps" ? "lamps" : `a ${kind}`}` : "Separation";
}

/** Its state, and which job it is, for the browser's tab. */
export function titleOf(job) {
  return `${stateOf(job)}: ${kindOf(job)} ${job.id.slice(0, 8)}`;
}
