// Elements in one line, and sentences for people.

import { changeKey, key } from "./api.js";

/** Make an element. Of props, on… are listeners, aria-… and data-… attributes, others properties. */
export function h(tag, props = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(props)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (/^(aria-|data-|role$|for$|list$|capture$)/.test(name)) element.setAttribute(name, value);
    else element[name] = value;
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

/** A toggle that tells its state to screen readers: the button, with `pressed` to set. */
export function toggle(text, label, pressed, change) {
  const button = h("button", {
    type: "button",
    className: "toggle",
    textContent: text,
    "aria-label": label,
    onclick: () => change(button.getAttribute("aria-pressed") !== "true"),
  });
  button.setAttribute("aria-pressed", String(pressed));
  return button;
}

/** One of several choices: radio buttons that look like one bar. */
export function choice(label, options, chosen, change) {
  const name = `choice${count++}`;
  return h(
    "div",
    { className: "choice", role: "radiogroup", "aria-label": label },
    ...options.map(([value, text]) =>
      h(
        "label",
        {},
        h("input", { type: "radio", name, value, checked: value === chosen, onchange: () => change(value) }),
        h("span", { textContent: text }),
      ),
    ),
  );
}

/** A listener that does nothing while its work is under way or its button is held: else a double click were two. */
export function single(work) {
  let busy = false;
  return async (event) => {
    event.preventDefault();
    if (busy || event.currentTarget.getAttribute("aria-disabled") === "true") return;
    busy = true;
    try {
      await work(event);
    } finally {
      busy = false;
    }
  };
}

/** Have a button do nothing for a while, or again; disabled it would lose the keyboard. */
export function hold(button, held) {
  button.setAttribute("aria-disabled", String(held));
}

/** Whether a key is meant for the browser or the system, like those that enlarge the page. */
export function isShortcut(event) {
  return event.ctrlKey || event.metaKey || event.altKey;
}

/** Name the view in the browser's tab and history, which show the beginning alone. */
export function entitle(text) {
  document.title = `${text} · lightlayers`;
}

/** Tell it to screen readers. */
export function say(text) {
  document.getElementById("said").textContent = text;
}

/** A button for where there is no key, or none for this. again(): called with another one. */
export function otherKey(again) {
  const change = single(async () => (await changeKey()) && again());
  return h("button", { type: "button", textContent: key() ? "Use another key" : "Enter a key", onclick: change });
}

/** A problem as people see it. again(): as of otherKey, and for what may well work later; else the problem goes, and they try it again themselves. */
export function alarm(error, again) {
  const later = again && (error.status === 0 || error.status >= 500);
  const element = h(
    "div",
    { className: "alarm", role: "alert" },
    h("strong", { textContent: error.title ?? "That did not work" }),
    h("p", { textContent: error.message }),
    error.ofKey ? h("p", {}, otherKey(again ?? (() => element.remove()))) : null,
    later ? h("p", {}, h("button", { type: "button", textContent: "Try again", onclick: again })) : null,
  );
  return element;
}

export function bytes(size) {
  if (size < 1000) return size === 1 ? "1 byte" : `${size} bytes`;
  const [unit, name] = [[1e9, "GB"], [1e6, "MB"], [1e3, "kB"]].find(([least]) => size >= least);
  return `${(size / unit).toLocaleString("en", { maximumFractionDigits: size < 10 * unit ? 1 : 0 })} ${name}`;
}

/** Whether this is the window that is used. A browser without TLS has six connections to a service, for
 * all its windows, which their streams of events would take: the one that is used has one, others ask.
 */
export function isUsed() {
  return !document.hidden && document.hasFocus();
}

/** What tells that isUsed may have changed, as targets and types of events. */
export const USE = [[document, "visibilitychange"], [window, "focus"], [window, "blur"]];

/** Wait for so many ms, or until the window is used or no longer, or the user leaves. */
export function pause(time, signal) {
  return wait(time, signal, USE);
}

/** Wait for so many ms, or until a signal, or one of these targets and types of events. */
export function wait(time, signal, sooner = []) {
  const over = new AbortController();
  return new Promise((resolve) => {
    const end = () => {
      over.abort();
      clearTimeout(timer);
      resolve();
    };
    const timer = setTimeout(end, time);
    for (const [target, type] of [[signal, "abort"], ...sooner]) {
      target.addEventListener(type, end, { signal: over.signal });
    }
  });
}

let count = 0;
