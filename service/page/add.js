// Two photographs of a job to be: dropped, picked, taken by the phone, or by a connected camera.

import { newOnce, post } from "./api.js";
import { showCameras } from "./cameras.js";
import { alarm, bytes, h, hold, say, single } from "./dom.js";
import { goTo, tellProblem } from "./notes.js";
import { lampCount, lightsOf } from "./otherwise.js";
import { forget, sendFiles } from "./uploads.js";

const FRAMES = [
  ["no_flash", "Without the flash", "Only the lamps of the room light it."],
  ["flash", "With the flash", "From the same place, nothing moved, the same exposure."],
];
const KINDS =
  "image/*,.dng,.nef,.nrw,.cr2,.cr3,.crw,.arw,.sr2,.srw,.raf,.orf,.rw2,.rwl,.pef,.3fr,.iiq,.gpr,.tif,.tiff,.exr,.heic,.heif,.hif";
const LEFT_OUT = { title: "Two photographs make a pair", message: "The others were left out." };
const NO_FILES = { title: "No photographs there", message: "Folders, and pictures out of other pages, cannot be taken: drop the files themselves." };

/** What is filled in; once: its Idempotency-Key, the same for what is sent again after its answer got lost. */
const empty = () => ({ files: {}, lamps: "auto", once: newOnce() });

let draft = empty(); // as the view was left: a photograph that a phone took for it is nowhere else
let refill = () => {}; // has the view that is shown, in which nothing is filled in, show the draft

export function showAdd(main, signal) {
  let mine = draft;
  let { files } = mine;
  const problems = h("div");
  const go = h("button", { className: "main", textContent: "Separate the light", disabled: true });
  const sent = h("progress", { max: 1, value: 0, hidden: true, "aria-label": "Sent" });
  const cancel = h("button", { type: "button", textContent: "Cancel", hidden: true });
  const enable = () => (go.disabled = swap.disabled = FRAMES.some(([frame]) => !files[frame]));
  const changed = () => {
    mine.once = newOnce();
    draft = mine;
  };
  const put = (chosen, first) => {
    chosen.forEach((file, index) => {
      files[FRAMES[first + index][0]] = file;
      zones[first + index].show(file);
    });
    changed();
    enable();
  };
  const swap = h("button", {
    type: "button",
    textContent: "Swap",
    "aria-label": "Swap the two photographs",
    disabled: true,
    onclick: () => put([files.flash, files.no_flash], 0),
  });
  const zones = FRAMES.map(([, title, hint], index) =>
    zone(title, hint, (chosen, folders) => {
      if (pair.disabled) return; // dropped
      const problem = !chosen.length ? NO_FILES : folders || chosen.length > 2 ? LEFT_OUT : null;
      problems.replaceChildren(...(problem ? [alarm(problem)] : []));
      if (chosen.length > 1) put(inOrder(chosen.slice(0, 2)), 0);
      else if (chosen.length) put(chosen, index);
    }),
  );
  const lamps = lampCount(mine.lamps, () => ((mine.lamps = lamps.value), changed()));
  const options = () => lightsOf(lamps);
  const pair = h("fieldset", { className: "zones" }, ...zones.map((one) => one.element));
  const choices = h("fieldset", { className: "row" }, h("label", {}, "Lamps ", lamps), swap);
  const occupy = (sending) => {
    pair.disabled = choices.disabled = sending; // what is on its way does not change any more
    hold(go, sending);
    sent.hidden = !sending;
    offerCancel(sending);
  };
  const offerCancel = (offered) => {
    if (!offered && document.activeElement === cancel) go.focus(); // else its keyboard were lost
    cancel.hidden = !offered;
  };
  const progress = (fraction) => {
    sent.value = fraction;
    offerCancel(fraction < 1); // then a job may have been made of it, which has a button of its own
  };
  const attempt = (work) =>
    single(async () => {
      problems.replaceChildren();
      try {
        goTo(await work(), signal);
      } catch (error) {
        if (error.name === "AbortError") say("The photographs were not sent.");
        else tellProblem(error, problems, signal);
      }
    });
  const form = h(
    "form",
    {
      className: "add",
      onsubmit: attempt(() => {
        const photographs = FRAMES.map(([frame]) => files[frame]);
        const wanted = options();
        const canceled = new AbortController();
        cancel.onclick = () => canceled.abort();
        progress(0);
        occupy(true);
        say("The photographs are being sent.");
        draft = empty();
        return staying(submit(photographs, wanted, mine.once, progress, canceled.signal))
          .catch((error) => {
            if (!Object.keys(draft.files).length) {
              draft = mine;
              refill();
            }
            throw error;
          })
          .finally(() => occupy(false));
      }),
    },
    pair,
    h("div", { className: "row" }, choices, go, sent, cancel),
    problems,
  );
  main.classList.add("narrow");
  main.append(
    h("h1", { textContent: "The light of every lamp, apart" }),
    h("p", { className: "lead", textContent: "Two photographs from the same place: one without the flash, one with it." }),
    form,
  );
  const fill = () => {
    lamps.value = mine.lamps;
    FRAMES.forEach(([frame], index) => files[frame] && zones[index].show(files[frame]));
    enable();
  };
  refill = () => {
    if (signal.aborted || pair.disabled) return; // what is being sent is what is shown
    mine = draft;
    files = mine.files;
    fill();
  };
  fill();
  showCameras(main, signal, attempt, options);
}

/** Send a pair, without and with the flash, and have a job made of it; gives the job. */
async function submit(pair, options, once, sent, signal) {
  const ids = await sendFiles(pair, sent, signal);
  const uploads = Object.fromEntries(FRAMES.map(([frame], index) => [frame, ids[index]]));
  try {
    return await post("/jobs", { uploads, options }, once);
  } catch (error) {
    if ([400, 413, 422].includes(error.status)) forget(pair); // of any other the same may do
    throw error;
  }
}

/** Wait for what would be lost with the page, which the browser asks about meanwhile. */
async function staying(work) {
  const ask = (event) => event.preventDefault();
  addEventListener("beforeunload", ask);
  try {
    return await work;
  } finally {
    removeEventListener("beforeunload", ask);
  }
}

/** Two files, the one without the flash first as far as their names tell, as those of a capture do. */
function inOrder(two) {
  const tells = ({ name }) => (/(^|[^a-z])no[ _-]?flash|without/i.test(name) ? 0 : /flash/i.test(name) ? 2 : 1);
  return two.sort((a, b) => tells(a) - tells(b)); // stable: where names tell nothing, as they came
}

/** Files among what was dropped, and whether there were folders besides. */
function droppedOf({ items }) {
  const all = [...items].filter((item) => item.kind === "file");
  const files = all.filter((item) => !item.webkitGetAsEntry()?.isDirectory);
  return [files.map((item) => item.getAsFile()), files.length < all.length];
}

/** A place for one photograph; chosen(files, folders) is called with what was dropped or picked, and whether folders were. */
function zone(title, hint, chosen) {
  const picture = h("div", { className: "chosen" });
  const input = (more) =>
    h("input", {
      type: "file",
      className: "unseen",
      ...more,
      onchange: ({ target }) => {
        if (target.files.length) chosen([...target.files], false);
        target.value = ""; // else the same file, replaced meanwhile, could not be chosen again
      },
    });
  const pick = input({ accept: KINDS, multiple: true, "aria-label": `Choose a file: ${title}` });
  const shoot = input({ accept: "image/*", capture: "environment", "aria-label": `Use the camera: ${title}` });
  const element = h(
    "section",
    { className: "zone", "aria-label": title },
    h("h2", { textContent: title }),
    picture,
    h("p", { textContent: hint }),
    h(
      "p",
      { className: "row" },
      h("label", { className: "button" }, pick, "Choose a file"),
      h("label", { className: "button touch" }, shoot, "Use the camera"),
    ),
  );
  for (const [type, over] of [["dragover", true], ["dragleave", false], ["drop", false]]) {
    element.addEventListener(type, (event) => {
      event.preventDefault();
      element.classList.toggle("over", over);
      if (type === "drop") chosen(...droppedOf(event.dataTransfer));
    });
  }
  const show = (file) => {
    const name = h("span", { className: "name" }, h("bdi", { textContent: file.name }), ` · ${bytes(file.size)}`);
    const src = URL.createObjectURL(file);
    const free = () => URL.revokeObjectURL(src); // else the file stays in memory while the page is open
    const image = h("img", { alt: "", src, onload: free, onerror: () => (free(), image.remove()) });
    picture.replaceChildren(image, name);
    element.classList.add("filled");
    say(`${title}: ${file.name}`);
  };
  return { element, show };
}
