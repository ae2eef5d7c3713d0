// What is set on a camera: time, aperture, ISO and the like, as far as it lets them be chosen.

import { get, patch } from "./api.js";
import { alarm, h, say } from "./dom.js";

/** Settings that are asked for when they are opened. */
export function settingsOf(camera, name) {
  const path = `/cameras/${encodeURIComponent(camera.id)}/settings`;
  const body = h("div", { className: "row" });
  const element = h("details", {}, h("summary", { textContent: "Settings", "aria-label": `Settings of ${name}` }), body);
  const show = (found) => body.replaceChildren(...Object.entries(found).map(([key, one]) => controlOf(key, one, change)));
  const change = async (key, value) => {
    try {
      show(await patch(path, { [key]: value }));
      say(`${wordOf(key)} is ${value}.`);
    } catch (error) {
      show(await get(path).catch(() => ({})));
      body.append(alarm(error));
    }
  };
  element.addEventListener("toggle", async () => {
    if (!element.open) return;
    body.replaceChildren("…");
    try {
      show(await get(path));
    } catch (error) {
      body.replaceChildren(alarm(error));
    }
  });
  return element;
}

function controlOf(key, { value, choices, writable }, change) {
  if (!writable || !choices?.length) return h("span", { className: "setting" }, `${wordOf(key)}: ${value}`);
  const select = h("select", {}, ...choices.map((one) => h("option", { value: String(one), textContent: String(one), selected: one === value })));
  select.addEventListener("change", () => change(key, choices[select.selectedIndex]));
  return h("label", { className: "setting" }, `${wordOf(key)} `, select);
}

function wordOf(key) {
  const known = { iso: "ISO", shutter_s: "Time in s", f_number: "f-number" };
  const text = key.replaceAll("_", " ");
  return known[key] ?? text[0].toUpperCase() + text.slice(1);
}
