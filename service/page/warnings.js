// What the manifest warns of, in words, and where that is.

import { h, toggle } from "./dom.js";

const FILLED = ["flash_too_weak", "clipped"]; // where layers were filled in
const UNEXPLAINED = ["reflections", "unexplained", "four_or_more", "moved"]; // residual.png shows them

/** Elements; mark(on) marks what was filled in, residual() shows what the lamps do not explain. */
export function warningsOf(warnings, mark, residual) {
  if (!warnings.length) return [];
  const items = warnings.map(({ code, message, figures }) => {
    const item = h("li", {}, h("p", { textContent: message }));
    const row = h("p", { className: "row" });
    if (FILLED.includes(code) && mark) {
      const show = toggle("Show where", `Show where: ${message}`, false, (on) => {
        show.setAttribute("aria-pressed", String(on));
        mark(on);
      });
      row.append(show);
    }
    if (UNEXPLAINED.includes(code) && residual) {
      row.append(h("button", { type: "button", className: "toggle", textContent: "Show where", onclick: residual }));
    }
    const numbers = Object.entries(figures).map(([name, value]) => `${name.replaceAll("_", " ")} ${value}`);
    row.append(h("small", { textContent: [code, ...numbers].join(" · ") }));
    item.append(row);
    return item;
  });
  const title = `${warnings.length} ${warnings.length === 1 ? "warning" : "warnings"}`;
  return [h("details", { className: "warnings", open: true }, h("summary", { textContent: title }), h("ul", {}, ...items))];
}
