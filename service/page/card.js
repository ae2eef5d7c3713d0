// A job in the list of jobs.

import { deleteJob } from "./actions.js";
import { showIn } from "./api.js";
import { h, single } from "./dom.js";
import { tellProblem } from "./notes.js";
import { kindOf, stateOf } from "./words.js";

/** A card: its element, the job as it was shown last, and show(job) for how it is now. gone(): it was deleted. signal: ends with the list. */
export function cardOf(job, gone, signal) {
  const made = new Date(job.created).toLocaleString([], { dateStyle: "medium", timeStyle: "short" });
  const picture = h("div", { className: "thumb" });
  const state = h("span");
  const problems = h("div");
  const remove = single(async () => {
    problems.replaceChildren();
    try {
      if (await deleteJob(job)) gone();
    } catch (error) {
      tellProblem(error, problems, signal);
    }
  });
  const element = h(
    "li",
    {},
    h(
      "a",
      { href: `#/jobs/${job.id}` },
      picture,
      h("strong", { textContent: kindOf(job) }),
      state,
      h("time", { dateTime: job.created, textContent: made }),
    ),
    h("button", { type: "button", className: "link", textContent: "Delete", "aria-label": `Delete ${kindOf(job)} of ${made}`, onclick: remove }),
    problems,
  );
  let thumbnail = null;
  const card = { element, job };
  card.show = (now) => {
    card.job = now;
    state.className = `state ${now.state}`;
    state.textContent = stateOf(now);
    if (!thumbnail && (thumbnail = thumbnailOf(now))) addPicture(picture, thumbnail, signal);
  };
  card.show(job);
  return card;
}

/** Where the small photograph of a job is, null where it has none. */
function thumbnailOf({ id, options, files }) {
  const name = "results/thumbnail.jpg";
  if (options.kind === "mix") return `/jobs/${options.of}/${name}`;
  return files.some((file) => file.name === "thumbnail.jpg") ? `/jobs/${id}/${name}` : null;
}

async function addPicture(place, path, signal) {
  const image = h("img", { alt: "", onerror: () => image.remove() });
  try {
    await showIn(image, path, signal);
    place.append(image);
  } catch {
    // the photograph may have been deleted: the card does without
  }
}
