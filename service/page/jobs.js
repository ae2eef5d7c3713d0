// The list of jobs.

import { get, showIn } from "./api.js";
import { deleteJob } from "./actions.js";
import { alarm, h, single } from "./dom.js";

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
  const problems = h("div");
  main.append(h("h1", { textContent: "Jobs" }), problems, list, more);
  const gone = (card) => {
    ((card.nextElementSibling ?? card.previousElementSibling)?.querySelector("a") ?? main).focus();
    card.remove();
  };
  let next = "/jobs?limit=48";
  const older = single(async () => {
    problems.replaceChildren();
    await load().catch((error) => problems.replaceChildren(alarm(error)));
  });
  const load = async () => {
    const page = await get(next);
    if (signal.aborted) return;
    const held = more.contains(document.activeElement); // else its keyboard were lost with the button
    const cards = page.jobs.map((job) => card(job, gone, problems));
    list.append(...cards);
    if (held) cards[0]?.querySelector("a").focus();
    next = page.next;
    more.replaceChildren(
      ...(next ? [h("button", { type: "button", textContent: "Older jobs", onclick: older })] : []),
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

/** Its state, and which job it is, for the browser's tab. */
export function titleOf(job) {
  return `${stateOf(job)}: ${kindOf(job)} ${job.id.slice(0, 8)}`;
}

function card(job, gone, problems) {
  const shown = new Date(job.created).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
  const picture = h("div", { className: "thumb" });
  addThumbnail(picture, job);
  const remove = async () => {
    problems.replaceChildren();
    try {
      if (await deleteJob(job)) gone(item);
    } catch (error) {
      problems.replaceChildren(alarm(error));
    }
  };
  const item = h(
    "li",
    {},
    h(
      "a",
      { href: `#/jobs/${job.id}` },
      picture,
      h("strong", { textContent: kindOf(job) }),
      h("span", { className: `state ${job.state}`, textContent: stateOf(job) }),
      h("time", { dateTime: job.created, textContent: shown }),
    ),
    h("button", { type: "button", className: "link", textContent: "Delete", "aria-label": `Delete ${kindOf(job)} of ${shown}`, onclick: remove }),
  );
  return item;
}

async function addThumbnail(place, job) {
  const of = job.options.kind === "mix" ? job.options.of : job.id;
  const has = job.files.some((file) => file.name === "thumbnail.jpg") || of !== job.id;
  if (!has) return;
  const image = h("img", { alt: "", onerror: () => image.remove() });
  try {
    await showIn(image, `/jobs/${of}/results/thumbnail.jpg`);
    place.append(image);
  } catch {
    // the photograph may have been deleted: the card does without
  }
}
