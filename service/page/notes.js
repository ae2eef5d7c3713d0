// How what was asked for ended: in its view, or above all views where the user has left that meanwhile.

import { alarm, h, say } from "./dom.js";

/** Go to a job that was made, but take nobody away from another view. */
export function goTo(job, signal) {
  const href = `#/jobs/${job.id}`;
  if (!signal.aborted) {
    location.hash = href;
    return;
  }
  const words = "The job that you asked for is made.";
  note(h("p", { textContent: words }), h("a", { className: "button", href, textContent: "Show it" }));
  say(words);
}

/** Tell a problem at its place, where it is seen. */
export function tellProblem(error, place, signal) {
  if (!signal.aborted) {
    place.replaceChildren(alarm(error));
    place.scrollIntoView({ block: "nearest" });
    return;
  }
  note(alarm({ title: `What you asked for before was not done: ${error.title ?? "it failed"}`, message: error.message }));
}

/** Show elements above every view until they are answered. */
function note(...elements) {
  const close = h("button", { type: "button", textContent: "Close" });
  const element = h("section", { className: "note", "aria-label": "What you asked for before" }, ...elements, close);
  element.addEventListener("click", ({ target }) => {
    if (!target.closest("a, button")) return;
    if (target === close) document.getElementById("main").focus(); // else the keyboard were lost with the button
    element.remove();
  });
  document.getElementById("notes").append(element);
}
