// Reads preview.exr: plain scan lines of 16-bit floats, as pipeline/encode/preview.py writes them.

const MAGIC = 20000630;

/** Width, height and, by channel, the half floats of a picture; throws an Error for any other EXR. */
export function readExr(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 8 || view.getUint32(0, true) !== MAGIC) throw new Error("The preview is no EXR.");
  const { attributes, end } = readHeader(view);
  const names = channelNames(attributes.get("channels"));
  const window = attributes.get("dataWindow");
  const width = window.getInt32(8, true) - window.getInt32(0, true) + 1;
  const height = window.getInt32(12, true) - window.getInt32(4, true) + 1;
  const top = window.getInt32(4, true);
  if (attributes.get("compression").getUint8(0) !== 0) throw new Error("The preview is compressed.");
  const channels = new Map(names.map((name) => [name, new Uint16Array(width * height)]));
  for (let line = 0; line < height; line++) {
    const place = Number(view.getBigUint64(end + 8 * line, true));
    const row = view.getInt32(place, true) - top;
    const values = new Uint16Array(buffer.slice(place + 8, place + 8 + 2 * width * names.length));
    names.forEach((name, index) => {
      channels.get(name).set(values.subarray(index * width, (index + 1) * width), row * width);
    });
  }
  return { width, height, channels };
}

/** Half floats of a lamp's red, green, blue and of the confidence, pixel by pixel, as WebGL takes them. */
export function interleave({ channels, width, height }, lamp) {
  const all = new Uint16Array(4 * width * height);
  const from = ["R", "G", "B"].map((letter) => channels.get(`lamp${lamp + 1}.${letter}`));
  [...from, channels.get("Y")].forEach((plane, offset) => {
    if (plane) for (let pixel = 0, place = offset; pixel < plane.length; pixel++, place += 4) all[place] = plane[pixel];
  });
  return all;
}

/** 32-bit floats of 16-bit ones. */
export function widened(halves) {
  table ??= Float32Array.from({ length: 65536 }, (_, bits) => valueOf(bits));
  const all = new Float32Array(halves.length);
  for (let place = 0; place < all.length; place++) all[place] = table[halves[place]];
  return all;
}

let table = null;

function valueOf(bits) {
  const exponent = (bits >> 10) & 31;
  const rest = bits & 1023;
  const size = exponent ? 2 ** (exponent - 15) * (1 + rest / 1024) : 2 ** -24 * rest;
  return (bits & 0x8000 ? -1 : 1) * (exponent === 31 ? 65504 : size);
}

function readHeader(view) {
  const attributes = new Map();
  let place = 8;
  const text = () => {
    let read = "";
    for (let code; (code = view.getUint8(place++)); ) read += String.fromCharCode(code);
    return read;
  };
  for (let name; (name = text()); ) {
    text(); // its type
    const size = view.getInt32(place, true);
    attributes.set(name, new DataView(view.buffer, place + 4, size));
    place += 4 + size;
  }
  return { attributes, end: place };
}

function channelNames(list) {
  const names = [];
  let place = 0;
  while (list.getUint8(place)) {
    let name = "";
    for (let code; (code = list.getUint8(place++)); ) name += String.fromCharCode(code);
    if (list.getInt32(place, true) !== 1) throw new Error("The preview has other numbers than 16-bit floats.");
    names.push(name);
    place += 16;
  }
  return names;
}
