// The list of jobs, kept as they are.

import { get, key } from "./api.js";
import { cardOf } from "./card.js";
import { h, pause, single } from "./dom.js";
import { tellProblem } from "./notes.js";
import { ENDED } from "./watch.js";

const FIRST = 48; // jobs that are shown at first
const MOST = 200; // that may be asked for at once
const AGAIN_MS = 10000; // until jobs of which some are under way are asked for again
const STILL_MS = 100; // after it was scrolled; browsers take few notes of that a second

export async function showJobs(main, signal) {
  const left = history.state; // where it was, if the user comes back
  const keepPlace = () => history.replaceState({ jobs: cards.size, y: scrollY }, "");
  const list = h("ul", { className: "jobs", onclick: keepPlace });
  const none = h("p", { hidden: true }, "There are none yet. ", h("a", { href: "#/", textContent: "Add two photographs." }));
  const problems = h("div");
  const cards = new Map();
  let next = `/jobs?limit=${Math.min(MOST, Math.max(FIRST, left?.jobs ?? 0))}`;
  let newest = 0; // when that was made
  const drop = ({ element, job }) => {
    const beside = element.nextElementSibling ?? element.previousElementSibling;
    if (element.contains(document.activeElement)) (beside?.querySelector("a") ?? main).focus(); // else its keyboard were lost
    element.remove();
    cards.delete(job.id);
    none.hidden = cards.size > 0;
  };
  const make = (job) => {
    const card = cardOf(job, () => drop(card), signal);
    cards.set(job.id, card);
    newest = Math.max(newest, timeOf(job));
    return card.element;
  };
  const load = async () => {
    const page = await get(next);
    if (signal.aborted) return;
    const held = document.activeElement === older; // else its keyboard were lost with the button
    const made = page.jobs.map(make);
    list.append(...made);
    if (held) made[0]?.querySelector("a").focus();
    next = page.next;
    older.hidden = !next;
    none.hidden = cards.size > 0;
  };
  const tried = async () => {
    problems.replaceChildren();
    return load().then(() => true, (error) => tellProblem(error, problems, signal));
  };
  const older = h("button", { type: "button", textContent: "Older jobs", hidden: true, onclick: single(tried) });
  /** Show how jobs are now, those that were made meanwhile, and no longer those that are gone. */
  const refresh = async () => {
    const page = await get(`/jobs?limit=${Math.min(MOST, Math.max(FIRST, cards.size))}`);
    if (signal.aborted) return;
    const now = new Map(page.jobs.map((job) => [job.id, job]));
    const oldest = page.next ? timeOf(page.jobs.at(-1)) : 0;
    for (const card of [...cards.values()]) {
      const { id } = card.job;
      if (now.has(id)) card.show(now.get(id));
      else if (timeOf(card.job) > oldest) drop(card);
    }
    list.prepend(...page.jobs.filter((job) => timeOf(job) > newest).map(make));
    none.hidden = cards.size > 0;
  };
  main.append(h("h1", { textContent: "Jobs" }), list, none, h("p", {}, older), problems);
  await load();
  while (cards.size < left?.jobs && next && !signal.aborted) {
    if (!(await tried())) break; // those that came are shown
  }
  if (signal.aborted) return;
  if (left) scrollTo(0, left.y);
  let timer;
  const scrolled = () => {
    clearTimeout(timer);
    timer = setTimeout(keepPlace, STILL_MS);
  };
  addEventListener("scroll", scrolled, { signal });
  signal.addEventListener("abort", () => clearTimeout(timer)); // then it is the place of another view
  keepUp(refresh, () => [...cards.values()].some(({ job }) => !ENDED.includes(job.state)), problems, signal);
}

/** Refresh what is shown whenever the tab is seen again, and in between as long as something is under way.
 *
 * A key that is refused is told of in an element, once: that it was asked for, and not given, is an answer.
 */
async function keepUp(refresh, isUnderWay, problems, signal) {
  let refused; // the key that was not taken
  while (!signal.aborted) {
    const unseen = document.hidden;
    await pause(AGAIN_MS, signal);
    if (signal.aborted || document.hidden || !(unseen || isUnderWay()) || refused === key()) continue;
    await refresh().catch((error) => {
      if (!error.ofKey) return console.error(error); // it is asked for again
      refused = key();
      tellProblem(error, problems, signal);
    });
  }
}

function timeOf(job) {
  return new Date(job.created).getTime();
}
