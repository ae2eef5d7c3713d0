// Server-sent events. EventSource could not send a key, so the stream is read by fetch.

import { fetchFrom } from "./api.js";
import { USE } from "./dom.js";

const FIRST_MS = 5000; // the first event comes at once; where it does not, something holds it back
const SILENCE_MS = 25000; // the service says something every 15 s

/** Read the events of a path until they end or break off; tell(data) is called with each.
 *
 * A window that is used no longer lets go of them: see isUsed.
 * Gives false where something on the way holds them back, so that asking again is better.
 * Throws the service's Problem where it has no such events.
 */
export async function follow(path, signal, tell) {
  if (signal.aborted) return true; // what listens to it from now on hears nothing
  const control = new AbortController();
  const stop = () => control.abort();
  for (const [target, type] of [[signal, "abort"], ...USE]) {
    target.addEventListener(type, stop, { once: true, signal: control.signal });
  }
  let late = false;
  const patience = (time) =>
    setTimeout(() => {
      late = true;
      stop();
    }, time);
  let timer = patience(FIRST_MS);
  try {
    const answer = await fetchFrom(path, control.signal);
    const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
    let text = "";
    for (let read; !(read = await reader.read()).done; ) {
      clearTimeout(timer);
      timer = patience(SILENCE_MS);
      const events = (text + read.value).split("\n\n");
      text = events.pop();
      events.map(dataOf).filter(Boolean).forEach((data) => tell(JSON.parse(data)));
    }
  } catch (error) {
    if (error.status) throw error;
  } finally {
    clearTimeout(timer);
    stop();
  }
  return !late;
}

function dataOf(event) {
  const lines = event.split("\n").filter((line) => line.startsWith("data:"));
  return lines.map((line) => line.slice(5).trimStart()).join("\n");
}
