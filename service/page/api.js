// Requests to the service. A key, where it asks for one, is kept in the tab alone.

import { keep, kept } from "./tab.js";

const KEY = "lightlayers-key";

/** What the service answered instead of what was asked for (RFC 9457), or that it did not answer. */
export class Problem extends Error {
  constructor({ type, title, detail, status }) {
    super(detail);
    this.title = title;
    this.status = status;
    const hidden = type === "urn:lightlayers:problem:unknown-job" && key(); // of jobs of other keys the service tells no more
    this.ofKey = status === 401 || type === "urn:lightlayers:problem:forbidden" || Boolean(hidden); // another key may do it
  }
}

const AWAY = {
  title: "No connection",
  detail: "The service does not answer; check that it runs and that this device is on its network.",
  status: 0,
};

let ahead = 0; // of this device's clock, in ms

export async function get(path) {
  const answer = await request(path);
  const sent = Date.parse(answer.headers.get("date"));
  if (sent) ahead = Date.now() - sent;
  return bodyOf(answer, "json");
}

/** A moment that the service tells, as this device's clock shows it, which may be wrong. */
export function hereAt(moment) {
  return new Date(Date.parse(moment) + ahead);
}

/** An Idempotency-Key: whatever is sent with the same one makes one job. */
export function newOnce() {
  return crypto.randomUUID?.() ?? String(Math.random()); // over http, browsers have the first on localhost alone
}

export async function post(path, body, once = newOnce()) {
  const headers = { "Content-Type": "application/json", "Idempotency-Key": once };
  return bodyOf(await request(path, { method: "POST", headers, body: JSON.stringify(body) }), "json");
}

/** Gives a post whose Idempotency-Key stays until a job is made or it says something else: an answer may get lost. */
export function sender() {
  let kept = null;
  return async (path, body) => {
    const said = JSON.stringify([path, body]);
    if (kept?.said !== said) kept = { said, once: newOnce() };
    const made = await post(path, body, kept.once);
    kept = null; // the same again is another job
    return made;
  };
}

/** Delete what is at a path. */
export async function remove(path) {
  await request(path, { method: "DELETE" });
}

export async function patch(path, body) {
  const headers = { "Content-Type": "application/json" };
  return bodyOf(await request(path, { method: "PATCH", headers, body: JSON.stringify(body) }), "json");
}

/** Answers of a path that may be waited for, or no longer. */
export function fetchFrom(path, signal) {
  return request(path, { signal });
}

/** A result from the service itself: the page may load nothing from a store that it redirects to. */
function fetchResult(path, signal) {
  return request(path, { headers: { Prefer: "no-redirect" }, signal });
}

/** Bytes of a result. signal: ends with the view, lest what nobody waits for holds up what the next one needs.
 *
 * came(fraction): called with each piece, where it is known how many there are.
 */
export async function fetchBytes(path, signal, came = () => {}) {
  const answer = await fetchResult(path, signal);
  const size = Number(answer.headers.get("content-length"));
  let sum = 0;
  const count = (piece, out) => {
    sum += piece.length;
    if (size) came(Math.min(1, sum / size)); // less than is read where a proxy has packed it
    out.enqueue(piece);
  };
  return bodyOf(new Response(answer.body.pipeThrough(new TransformStream({ transform: count }))), "arrayBuffer");
}

/** Show a result in an <img>, which could send neither a key nor a wish. signal: as of fetchBytes. */
export async function showIn(image, path, signal) {
  const src = await source(path, signal);
  const free = () => URL.revokeObjectURL(src); // else the picture stays in memory while the page is open
  for (const end of ["load", "error"]) image.addEventListener(end, free, { once: true });
  image.src = src;
}

async function source(path, signal) {
  return URL.createObjectURL(await bodyOf(await fetchResult(path, signal), "blob"));
}

/** Save a result as a file, which is fetched first: a store that it redirects to might show it in place of the page.
 *
 * direct: what no store gives; without a key the browser fetches it by itself. With one it cannot: a link sends
 * no header, and a key in its address would stay in histories and logs.
 */
export async function download(path, name, direct = false) {
  const link = document.createElement("a");
  link.href = direct && !key() ? path : await source(path);
  link.download = name;
  link.click();
  if (link.href.startsWith("blob:")) setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

/** Send bytes, as they are in a file. sent(bytes) is called while they are on their way. signal: gives it up, with an AbortError. */
export async function sendPiece(path, headers, bytes, sent, signal) {
  for (;;) {
    const tried = key();
    const answer = await send(path, headers, bytes, sent, signal); // fetch would not tell how far it is
    if (answer.status === 401 && (await otherKey(tried))) continue;
    if (answer.status >= 400) throw problemOf(answer.responseText, answer.status);
    return;
  }
}

function send(path, headers, bytes, sent, signal) {
  return new Promise((resolve, reject) => {
    const call = new XMLHttpRequest();
    call.open("PATCH", path);
    for (const [name, value] of Object.entries(headers)) call.setRequestHeader(name, value);
    if (key()) call.setRequestHeader("Authorization", `Bearer ${key()}`);
    call.upload.onprogress = (event) => sent(event.loaded);
    call.onload = () => resolve(call);
    call.onerror = () => reject(new Problem(AWAY));
    signal.onabort = () => (call.abort(), reject(signal.reason));
    call.send(bytes);
  });
}

/** Whether a file can still be read, since it is what was chosen. */
export async function isReadable(file) {
  return file.slice(0, 1).arrayBuffer().then(() => true, () => false);
}

/** Ask for something, with the key; gives the answer, which is no problem. */
export async function request(path, init = {}) {
  for (;;) {
    const tried = key();
    const headers = { ...init.headers, ...(tried ? { Authorization: `Bearer ${tried}` } : {}) };
    let answer;
    try {
      answer = await fetch(path, { ...init, headers });
    } catch {
      throw new Problem(AWAY);
    }
    if (answer.ok) return answer;
    if (answer.status === 401 && (await otherKey(tried))) continue;
    throw problemOf(await bodyOf(answer, "text"), answer.status);
  }
}

/** The body of an answer, read by one of its methods; one that breaks off is as bad as no answer. */
async function bodyOf(answer, method) {
  try {
    return await answer[method]();
  } catch {
    throw new Problem(AWAY);
  }
}

/** What an answer says went wrong: of a proxy it may be JSON of any kind, or none. */
function problemOf(text, status) {
  return new Problem({ title: "The service failed", detail: `It answered with ${status} and nothing to read.`, ...asJson(text), status });
}

function asJson(text) {
  try {
    return JSON.parse(text);
  } catch {
    return null;
  }
}

export function key() {
  return kept(KEY);
}

let asking = null;

/** Whether there is a key to try after one that was refused; it may have come while that was on its way. */
async function otherKey(refused) {
  return key() !== refused || askKey();
}

/** Have the user give another key than one that is good, but not for this; whether there is another. */
export async function changeKey() {
  const before = key();
  await askKey(false);
  return key() !== before;
}

/** Ask for a key, once for all requests that wait for it; whether one was given.
 *
 * refused: whether the one there is none.
 */
function askKey(refused = true) {
  asking ??= new Promise((resolve) => {
    const dialog = document.getElementById("key");
    const text = document.getElementById("key-text");
    text.value = "";
    document.getElementById("key-refused").hidden = !refused || !key(); // one that was sent already
    dialog.addEventListener(
      "close",
      () => {
        const typed = text.value.replace(/[^ -~]/g, "").trim(); // what no header can carry is in no key
        const given = dialog.returnValue === "ok" && typed !== ""; // else the dialog was left
        if (given) keep(KEY, typed);
        text.value = "";
        asking = null;
        resolve(given);
      },
      { once: true },
    );
    dialog.returnValue = ""; // else Esc would leave that of the last time
    dialog.showModal();
  });
  return asking;
}
