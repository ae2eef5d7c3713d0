// Connected cameras: how they are, their settings, and a button that has one take the pair.

import { get, sender } from "./api.js";
import { settingsOf } from "./camera_settings.js";
import { bytes, h, hold, isUsed, otherKey, pause } from "./dom.js";
import { follow } from "./events.js";
import { AWAY } from "./watch.js";

const STATES = { idle: "Ready", capturing: "Takes photographs", waiting_for_operator: "Waits for somebody", away: "Not connected", unable: "Cannot be released from here" };
const AGAIN_MS = 5000; // until what did not come is asked for again
const FLASH = [["", "The camera switches the flash"], ["external", "A relay or trigger switches it"], ["operator", "I switch it myself"]];

/** List the cameras below the form, and keep the list as they are; or tell why there is none.
 *
 * attempt(work): a listener that goes to the job which work makes. options(): of that job.
 */
export function showCameras(main, signal, attempt, options) {
  const list = h("ul");
  const refused = h("div", { className: "row" });
  const section = h("section", { className: "cameras", hidden: true }, h("h2", { textContent: "Or let a connected camera take both" }), refused, list);
  const rows = new Map();
  const show = (cameras) => {
    for (const camera of cameras) {
      const key = keyOf(camera);
      if (!rows.has(key)) {
        rows.set(key, rowOf(camera, attempt, options));
        list.append(rows.get(key).element);
      }
      rows.get(key).show(camera);
    }
    for (const [key, row] of rows) {
      if (cameras.some((camera) => keyOf(camera) === key)) continue;
      row.element.remove();
      rows.delete(key);
    }
    section.hidden = !cameras.length;
  };
  const begin = async () => {
    try {
      const found = await get("/cameras");
      if (signal.aborted) return;
      refused.replaceChildren();
      show(found);
      await keepUp(signal, show);
    } catch (error) {
      if (signal.aborted) return;
      show([]);
      const words = h("p", { className: "how", textContent: `No cameras are shown. ${error.message}` });
      refused.replaceChildren(words, ...(error.ofKey ? [otherKey(begin)] : []));
      section.hidden = false;
      if (!AWAY.includes(error.status)) return;
      await pause(AGAIN_MS, signal);
      if (!signal.aborted) begin();
    }
  };
  main.append(section);
  begin(); // for as long as the user stays
}

/** Show the cameras as they become, by their events, and by asking where those are held back or another window is used.
 *
 * Throws the service's Problem where it does not show them any more.
 */
async function keepUp(signal, show) {
  while (!signal.aborted) {
    try {
      const streams = isUsed() && (await follow("/cameras/events", signal, show));
      if (!streams && !document.hidden && !signal.aborted) show(await get("/cameras"));
    } catch (error) {
      if (!AWAY.includes(error.status)) throw error;
    }
    await pause(AGAIN_MS, signal);
  }
}

function rowOf(camera, attempt, options) {
  const name = nameOf(camera);
  const named = name !== camera.address;
  const which = named ? `${name} at ${camera.address}` : name; // there may be two of a model
  const send = sender();
  const how = h("span", { className: "how" });
  const flash = h(
    "select",
    { "aria-label": `Flash of ${which}` },
    ...FLASH.map(([value, textContent]) => h("option", { value, textContent })),
  );
  const button = h("button", {
    type: "button",
    textContent: "Capture",
    "aria-label": `Capture with ${which}`,
    onclick: attempt(() => capture(send, camera, flash.value, options())),
  });
  const element = h(
    "li",
    {},
    h("div", { className: "who" }, h("strong", { textContent: name }), " ", named ? h("code", { textContent: camera.address }) : null, how),
    flash,
    button,
    settingsOf(camera, which),
  );
  const show = (now) => {
    how.replaceChildren(...wordsOf(now));
    hold(button, now.state === "away" || now.state === "unable");
  };
  return { element, show };
}

async function capture(send, camera, flash, options) {
  const how = flash ? { flash } : {};
  const made = await send(`/cameras/${encodeURIComponent(camera.id)}/captures`, { ...how, options });
  return made.jobs[0];
}

/** State, and battery, space and who holds it, as far as it is known. */
function wordsOf({ state, battery_percent, free_bytes, holder, waiting }) {
  const words = [STATES[state]];
  if (Number.isFinite(battery_percent)) words.push(`battery ${battery_percent} %`);
  if (Number.isFinite(free_bytes)) words.push(`${bytes(free_bytes)} free`);
  if (waiting) words.push(`${waiting} waiting`);
  const text = words.join(" · ");
  const link = holder ? h("a", { href: `#/jobs/${holder}`, textContent: "by this job" }) : null;
  return [text, ...(link ? [" ", link] : [])];
}

/** What a row is known by: one that has been away since the start is named only once it has come. */
function keyOf(camera) {
  return `${camera.id} ${nameOf(camera)}`;
}

function nameOf({ make, model, address }) {
  if (!make && !model) return address;
  return model.startsWith(make.split(" ")[0]) ? model : `${make} ${model}`;
}
