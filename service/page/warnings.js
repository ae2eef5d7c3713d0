// What the manifest warns of, in words, and where that is.

import { h, toggle } from "./dom.js";

const FILLED = ["flash_too_weak", "clipped", "shines_itself"]; // where layers were filled in
const UNEXPLAINED = ["reflections", "unexplained", "four_or_more", "moved", "not_aligned", "light_changed", "flicker"]; // residual.png shows them
const LAMPS = ["lamps_alike", "lamps_ambiguous", "no_pure_light", "number_uncertain", "flash_like_lamps"]; // the diagram shows them
const NUMBER = ["number_uncertain", "unexplained", "lamps_alike"]; // another number of lamps may be asked for
const RATIO = ["exposure_assumed", "exposure_estimated", "exposure_mismatch", "flash_like_lamps"]; // another ratio may be given

/** Elements; show: functions that show what was filled in (on or off), what is unexplained and the
 * diagram of the lamps, where there are such pictures, and where their number and the exposure
 * ratio are told, which may be filled in.
 */
export function warningsOf(warnings, show) {
  if (!warnings.length) return [];
  const marks = []; // of the same places: they go on and off together
  const items = warnings.map(({ code, message, figures }) => {
    const item = h("li", {}, h("p", { textContent: message }));
    const row = h("p", { className: "row" });
    if (FILLED.includes(code) && show.filled) {
      const mark = toggle("Show where", `Show where: ${message}`, false, (on) => {
        for (const one of marks) one.setAttribute("aria-pressed", String(on));
        show.filled(on);
      });
      marks.push(mark);
      row.append(mark);
    }
    const look = (text, onclick) => h("button", { type: "button", className: "toggle", textContent: text, "aria-label": `${text}: ${message}`, onclick });
    if (UNEXPLAINED.includes(code) && show.unexplained) row.append(look("Show where", show.unexplained));
    if (LAMPS.includes(code) && show.lamps) row.append(look("Show the lamps", show.lamps));
    if (NUMBER.includes(code) && show.number) row.append(look("Change the number", show.number));
    if (RATIO.includes(code) && show.ratio) row.append(look("Change the ratio", () => show.ratio(figures.ratio_shown ?? figures.ratio_by_baseline)));
    const numbers = Object.entries(figures).map(([name, value]) => `${name.replaceAll("_", " ")} ${value}`);
    row.append(h("small", { textContent: [code, ...numbers].join(" · ") }));
    item.append(row);
    return item;
  });
  const title = `${warnings.length} ${warnings.length === 1 ? "warning" : "warnings"}`;
  return [h("details", { className: "warnings", open: true }, h("summary", { textContent: title }), h("ul", {}, ...items))];
}
