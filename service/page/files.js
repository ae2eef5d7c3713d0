// The files of a job, one by one or all at once.

import { download } from "./api.js";
import { bytes, h, hold, say, single } from "./dom.js";
import { tellProblem } from "./notes.js";

const WORDS = {
  "manifest.json": "What was found, as JSON",
  "layers.exr": "All layers, linear camera RGB",
  "layers.psd": "All layers in one file for editors",
  "preview.exr": "All layers, small, for the mixer",
  "thumbnail.jpg": "The photograph, small",
  "white_balanced_1.jpg": "Every lamp made neutral",
  "white_balanced_2.jpg": "All light made neutral",
  "white_balanced_1.tif": "Every lamp made neutral, 16-bit",
  "white_balanced_2.tif": "All light made neutral, 16-bit",
  "white_balanced.exr": "Both made neutral, linear camera RGB",
  "confidence.tif": "Where layers were separated",
  "gamma.png": "The light of every pixel, and the lamps",
  "residual.png": "What the lamps do not explain",
  "normals.png": "Surface normals",
  "normals.exr": "Surface normals, as numbers",
  "normals_confidence.tif": "How far each normal can be trusted",
  "depth.exr": "Depth along the camera's axis",
  "surface.glb": "The surface in 3-D",
  "response.jpg": "The photograph as another camera sees it",
  "response.exr": "All layers as another camera sees them",
  "marks.jpg": "Where the calibration was measured",
  "flash.json": "The spectrum of the flash",
  "camera.json": "The sensitivities of the camera",
  "lights.json": "The directions of the lamps",
  "mix.jpg": "The mix",
  "mix.tif": "The mix, 16-bit",
  "mix.exr": "The mix, linear sRGB",
};

/** A table of files with a button for each; signal: ends with the view. */
export function filesOf(job, signal) {
  const failed = h("div");
  const row = (file) =>
    h(
      "li",
      {},
      h("button", { type: "button", className: "link", textContent: file.name, onclick: save(file.href, file.name, failed, signal) }),
      h("span", { className: "what", textContent: WORDS[file.name] ?? wordsOf(file.name) }),
      h("span", { className: "size", textContent: bytes(file.size) }),
    );
  const all = bytes(job.files.reduce((sum, file) => sum + file.size, 0));
  return h(
    "div",
    { className: "files" },
    h("button", {
      type: "button",
      textContent: `Download all (${all})`,
      onclick: save(job.links.zip, `${job.id}.zip`, failed, signal, true),
    }),
    h("ul", {}, ...job.files.map(row)),
    failed,
  );
}

/** A listener of a button that saves a result once at a time, and tells in an element where that fails.
 *
 * signal: ends with the view. direct: as of download.
 */
export function save(path, name, failed, signal, direct) {
  return single(async ({ currentTarget: button }) => {
    const wait = h("span", { textContent: " – on its way …" });
    failed.replaceChildren();
    button.append(wait);
    hold(button, true);
    say(`${name} is on its way.`);
    try {
      await download(path, name, direct);
    } catch (error) {
      tellProblem(error, failed, signal);
    }
    wait.remove();
    hold(button, false);
    say("");
  });
}

function wordsOf(name) {
  const lamp = name.match(/^(response_)?lamp(\d)\.(\w+)$/);
  if (!lamp) return "";
  const [, response, number, ending] = lamp;
  return `The light of lamp ${number}${response ? " as another camera sees it" : ""}${ending === "tif" ? ", 16-bit" : ""}`;
}
