// Which part of the page is shown: #/ adds photographs, #/jobs lists jobs, #/jobs/ID is one of them.

import { showAdd } from "./add.js";
import { alarm, entitle, h, isShortcut, say } from "./dom.js";
import { showJob } from "./job.js";
import { showJobs } from "./jobs.js";

const main = document.getElementById("main");
let leave = new AbortController();

async function route() {
  leave.abort();
  leave = new AbortController();
  const { signal } = leave;
  const [, part, id] = location.hash.split("/");
  main.className = "";
  main.replaceChildren();
  say("");
  mark(part === "jobs" ? "#/jobs" : "#/");
  entitle(part !== "jobs" ? "Add two photographs" : id ? "Job" : "Jobs");
  try {
    if (part === "jobs" && id) await showJob(main, decoded(id), signal, arrive);
    else if (part === "jobs") await showJobs(main, signal);
    else showAdd(main, signal);
  } catch (error) {
    if (signal.aborted) return;
    console.error(error);
    entitle(error.title ?? "That did not work");
    main.append(alarm(error, arrive), h("p", {}, h("a", { className: "button", href: "#/", textContent: "Add two photographs" })));
  }
}

function decoded(id) {
  try {
    return decodeURIComponent(id);
  } catch {
    const message = `The address ends in ${id.slice(0, 80)}, which names no job: choose it under Jobs, or copy its address anew.`;
    throw Object.assign(new Error(message), { title: "No such job" });
  }
}

function mark(current) {
  for (const link of document.querySelectorAll("nav a")) {
    if (link.getAttribute("href") === current) link.setAttribute("aria-current", "page");
    else link.removeAttribute("aria-current");
  }
}

function arrive() {
  main.focus();
  route();
}

addEventListener("hashchange", arrive);
for (const link of document.querySelectorAll(".top a")) {
  link.addEventListener("click", (event) => {
    if (link.hash !== (location.hash || "#/") || isShortcut(event) || event.shiftKey) return;
    event.preventDefault(); // no hash may change there, which were told
    if (link.hash === "#/") main.focus(); // what is filled in there stays
    else {
      history.replaceState(null, ""); // from its beginning
      arrive();
    }
  });
}
for (const type of ["dragover", "drop"]) {
  addEventListener(type, (event) => event.preventDefault()); // else a file beside its place were opened instead of the page
}
route();
