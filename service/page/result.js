// The results of a separation: the picture, a strip for each lamp, warnings, files.

import { actionsOf } from "./actions.js";
import { fetchBytes, get, showIn } from "./api.js";
import { normalsForm } from "./directions.js";
import { alarm, h } from "./dom.js";
import { readExr } from "./exr.js";
import { filesOf } from "./files.js";
import { knownForm } from "./known.js";
import { mixer } from "./mixer.js";
import { otherwiseForm } from "./otherwise.js";
import { Views } from "./views.js";
import { warningsOf } from "./warnings.js";

/** again(): shows them anew. */
export async function showResult(main, job, signal, again) {
  const manifest = await get(job.links.results);
  if (signal.aborted) return;
  const has = (name) => job.files.some((file) => file.name === name);
  main.className = "result";
  const picture = h("div", { className: "picture" });
  const bar = h("div", { className: "bar" });
  const foot = h("div", { className: "foot" });
  const desk = h("div", { className: "desk" });
  main.append(
    h("h1", { className: "unseen", textContent: "Light mixer" }),
    h("section", { className: "stage", "aria-label": "Picture" }, bar, picture, foot),
    h("section", { className: "controls", "aria-label": "Lamps and files" }, desk),
  );
  const views = new Views(picture, bar, foot, job, signal);
  let light = null;
  if (manifest.mix && has("preview.exr")) {
    const wait = h("p", { className: "wait", textContent: "Loading the layers …" });
    picture.append(wait);
    const came = (fraction) => (wait.textContent = `Loading the layers … ${Math.floor(100 * fraction)} %`);
    // a thumbnail that does not come, or too late, is done without
    if (has("thumbnail.jpg")) thumbnail(job, signal).then((image) => wait.before(image), console.error);
    try {
      const preview = readExr(await fetchBytes(`/jobs/${job.id}/results/preview.exr`, signal, came));
      if (signal.aborted) return;
      light = mixer(views, desk, preview, job, manifest, signal);
    } catch (error) {
      if (signal.aborted) return;
      views.add("mix", "Mix", alarm(error, again)); // where the picture would be, beside the other views
    }
  } else {
    const message = "This job has no preview.exr, which the mixer needs; its files are below.";
    desk.append(alarm({ title: "No mixer", message }));
  }
  for (const [name, text] of pictures(manifest)) if (has(name)) views.addImage(name, text);
  if (has("normals.png")) views.addNormals(manifest.options.normals);
  views.start();
  const otherwise = otherwiseForm(job, signal);
  const show = {
    filled: light && ((on) => (views.choose("mix"), light.mark(on))),
    unexplained: has("residual.png") && (() => views.choose("residual.png")),
    lamps: has("gamma.png") && (() => views.choose("gamma.png")),
    number: otherwise.askNumber,
    ratio: otherwise.askRatio,
  };
  desk.append(
    ...warningsOf(manifest.warnings, show),
    otherwise.element,
    ...(light ? [knownForm(job, manifest, light, () => views.choose("mix"), signal)] : []),
    ...(manifest.lamps.length > 1 && !has("normals.png") ? [normalsForm(job, manifest, signal)] : []),
    h("details", {}, h("summary", { textContent: "Files" }), filesOf(job, signal)),
    actionsOf(job, signal),
  );
}

function pictures(manifest) {
  return [
    ["white_balanced_1.jpg", "White balanced"],
    ["response.jpg", "Other camera"],
    ["gamma.png", manifest.lamps.length > 1 ? "Why these lamps" : "Why this lamp"],
    ["residual.png", "Unexplained"],
  ];
}

async function thumbnail(job, signal) {
  const image = h("img", { alt: "", className: "early" });
  await showIn(image, `/jobs/${job.id}/results/thumbnail.jpg`, signal);
  return image;
}
