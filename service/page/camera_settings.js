// What is set on a camera: time, aperture, ISO and the like, as far as it lets them be chosen.

import { get, patch } from "./api.js";
import { alarm, h, say } from "./dom.js";

/** Settings that are asked for when they are opened. */
export function settingsOf(camera, name) {
  const path = `/cameras/${encodeURIComponent(camera.id)}/settings`;
  const body = h("div", { className: "row" });
  const element = h("details", {}, h("summary", { textContent: "Settings", "aria-label": `Settings of ${name}` }), body);
  const show = (found) => {
    const held = body.contains(document.activeElement) && document.activeElement.name; // else its keyboard were lost
    body.replaceChildren(...Object.entries(found).map(([key, one]) => controlOf(key, one, change)));
    if (held) ([...body.querySelectorAll("select")].find((one) => one.name === held) ?? element.querySelector("summary")).focus();
  };
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
  const options = choices.map((one) => h("option", { value: String(one), textContent: String(one), selected: one === value }));
  // what it is, but cannot be chosen
  const other = choices.includes(value) ? [] : [h("option", { textContent: String(value), selected: true, disabled: true })];
  const select = h("select", { name: key }, ...other, ...options);
  select.addEventListener("change", () => change(key, choices[select.selectedIndex - other.length]));
  return h("label", { className: "setting" }, `${wordOf(key)} `, select);
}

function wordOf(key) {
  const known = { iso: "ISO", shutter_s: "Time in s", f_number: "f-number" };
  const text = key.replaceAll("_", " ");
  return known[key] ?? text[0].toUpperCase() + text.slice(1);
}
