// The list of jobs.

import { get, source } from "./api.js";
import { h } from "./dom.js";

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

export async function showJobs(main, signal) {
  const list = h("ul", { className: "jobs" });
  const more = h("p");
  main.append(h("h1", { textContent: "Jobs" }), list, more);
  let next = "/jobs?limit=48";
  const load = async () => {
    const page = await get(next);
    if (signal.aborted) return;
    list.append(...page.jobs.map(card));
    next = page.next;
    more.replaceChildren(
      ...(next ? [h("button", { type: "button", textContent: "Older jobs", onclick: load })] : []),
    );
    if (!list.children.length) more.append("There are none yet. ", h("a", { href: "#/", textContent: "Add two photographs." }));
  };
  await load();
}

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

function card(job) {
  const time = new Date(job.created);
  const picture = h("div", { className: "thumb" });
  addThumbnail(picture, job);
  return h(
    "li",
    {},
    h(
      "a",
      { href: `#/jobs/${job.id}` },
      picture,
      h("strong", { textContent: kindOf(job) }),
      h("span", { className: `state ${job.state}`, textContent: stateOf(job) }),
      h("time", { dateTime: job.created, textContent: time.toLocaleString([], { dateStyle: "medium", timeStyle: "short" }) }),
    ),
  );
}

async function addThumbnail(place, job) {
  const of = job.options.kind === "mix" ? job.options.of : job.id;
  const has = job.files.some((file) => file.name === "thumbnail.jpg") || of !== job.id;
  if (!has) return;
  const image = h("img", { alt: "", loading: "lazy", onerror: () => image.remove() });
  try {
    image.src = await source(`/jobs/${of}/results/thumbnail.jpg`);
    place.append(image);
  } catch {
    // the photograph may have been deleted: the card does without
  }
}
