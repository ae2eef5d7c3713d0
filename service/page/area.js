// Areas of the layers in full size.

import { fetchBytes } from "./api.js";

/** Pixels of the photograph along the side of one of the preview, and a function that fetches areas. signal: ends with the view. */
export function fullSize(job, manifest, preview, signal) {
  const layers = manifest.files.find((file) => file.name === "layers.exr");
  const lamps = manifest.lamps.length;
  const fetchArea = async (left, top, width, height) => {
    const query = new URLSearchParams({ left, top, width, height });
    const planes = new Uint16Array(await fetchBytes(`/jobs/${job.id}/area?${query}`, signal));
    const size = width * height;
    const names = Array.from({ length: 3 * lamps }, (_, index) => `lamp${Math.floor(index / 3) + 1}.${"RGB"[index % 3]}`);
    return { width, height, channels: new Map(names.map((name, index) => [name, planes.subarray(index * size, (index + 1) * size)])) };
  };
  return { step: layers ? Math.floor(layers.width / preview.width) : 1, fetchArea };
}
