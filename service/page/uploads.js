// Photographs that are sent piece by piece (tus): what has come stays where the connection breaks, and is gone on with.

import { isReadable, request, sendPiece } from "./api.js";
import { bytes, wait } from "./dom.js";
import { AWAY } from "./watch.js";

const PIECE = 2 ** 23; // bytes
const PAUSES_MS = [500, 1000, 2000, 5000, 10000]; // between tries while nothing comes through
const TUS = { "Tus-Resumable": "1.0.0" };
const GONE = [404, 410];
const TOO_LARGE = 413;
const ELSEWHERE = 409; // a piece of which the answer got lost has come

const begun = new WeakMap(); // how far each file is: path, and offset, null where the service has to tell

/** Send files, or go on with it; gives the ids of their uploads. sent(fraction): of all. signal: gives it up, with an AbortError. */
export async function sendFiles(files, sent, signal) {
  const all = files.reduce((sum, file) => sum + file.size, 0);
  for (const file of files) if (begun.has(file)) begun.get(file).offset = null; // it may be gone meanwhile
  for (const file of files) await persistently(file, signal, () => whereOf(file, signal)); // where one may not come, none is sent
  let before = 0;
  const ids = [];
  for (const file of files) {
    const path = await sendFile(file, (bytes) => sent(all ? (before + bytes) / all : 1), signal);
    before += file.size;
    ids.push(path.split("/").at(-1));
  }
  return ids;
}

/** Forget what has come of files, which the service does not take. */
export function forget(files) {
  for (const file of files) {
    const path = begun.get(file)?.path;
    begun.delete(file);
    if (path) request(path, { method: "DELETE", headers: TUS }).catch(() => {}); // else it goes after a day
  }
}

async function sendFile(file, sent, signal) {
  return persistently(file, signal, async (cameOn) => {
    const upload = await whereOf(file, signal);
    while (upload.offset < file.size) {
      const { offset } = upload;
      upload.offset = null; // until there is an answer
      const piece = file.slice(offset, offset + PIECE);
      const headers = { ...TUS, "Content-Type": "application/offset+octet-stream", "Upload-Offset": offset };
      await sendPiece(upload.path, headers, piece, (bytes) => sent(offset + bytes), signal);
      upload.offset = offset + piece.size;
      cameOn();
    }
    sent(file.size);
    return upload.path;
  });
}

/** Do work for a file until it is done, again after a pause where nothing comes through; cameOn(): something has. */
async function persistently(file, signal, work) {
  let failures = 0;
  for (;;) {
    try {
      return await work(() => (failures = 0));
    } catch (error) {
      signal.throwIfAborted();
      if (!(await isReadable(file))) throw changed(file);
      if (GONE.includes(error.status)) begun.delete(file); // it is sent anew
      else if (error.status !== ELSEWHERE && !AWAY.includes(error.status)) throw error;
      if (failures === PAUSES_MS.length) throw error;
      await wait(PAUSES_MS[failures++], signal); // whatever window is used: the line is no better for it
      signal.throwIfAborted();
    }
  }
}

/** Where the upload of a file goes on, which is begun if it was not. */
async function whereOf(file, signal) {
  const known = begun.get(file);
  if (!known) {
    const headers = { ...TUS, "Upload-Length": file.size };
    const answer = await request("/uploads", { method: "POST", headers, signal }).catch(async (error) => {
      throw error.status === TOO_LARGE ? await tooLarge(file, signal) : error;
    });
    begun.set(file, { path: answer.headers.get("location"), offset: 0 });
  } else if (known.offset === null) {
    const answer = await request(known.path, { method: "HEAD", headers: TUS, signal });
    known.offset = Number(answer.headers.get("upload-offset"));
  }
  return begun.get(file);
}

/** That a file is too large, as people say it: the service knows neither its name nor whom it tells. */
async function tooLarge({ name, size }, signal) {
  const answer = await request("/uploads", { method: "OPTIONS", headers: TUS, signal });
  const most = bytes(Number(answer.headers.get("tus-max-size")));
  const message = `${name} has ${bytes(size)}, and this service takes ${most} at most: choose a smaller file.`;
  return Object.assign(new Error(message), { title: "A photograph is too large", status: TOO_LARGE });
}

function changed({ name }) {
  return Object.assign(new Error(`${name} was changed or removed after it was chosen: choose it again.`), { title: "A photograph has changed" });
}
