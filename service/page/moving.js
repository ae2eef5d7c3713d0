// A picture of layers, enlarged and moved by pointer, fingers, wheel and keys.

import { isShortcut } from "./dom.js";

/** Have a Light follow what is done on its canvas. */
export function moveBy(light) {
  const { canvas } = light;
  const fingers = new Map();
  const apart = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.addEventListener("wheel", (event) => {
    event.preventDefault();
    light.enlarge(Math.exp(-event.deltaY / 400), event.offsetX, event.offsetY);
  }, { passive: false });
  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!event.buttons) fingers.delete(event.pointerId); // a menu may have taken its end
    const held = fingers.get(event.pointerId);
    if (!held) return;
    const before = fingers.size === 2 ? apart() : null;
    fingers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (before) light.enlarge(apart() / before, event.offsetX, event.offsetY);
    else light.move(event.offsetX - held[0], event.offsetY - held[1]);
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => fingers.delete(event.pointerId));
  }
  const keys = {
    "+": () => light.enlarge(1.5),
    "-": () => light.enlarge(1 / 1.5),
    0: () => light.zoom(null),
    1: () => light.zoom(light.step),
    ArrowLeft: () => light.move(40, 0),
    ArrowRight: () => light.move(-40, 0),
    ArrowUp: () => light.move(0, 40),
    ArrowDown: () => light.move(0, -40),
  };
  canvas.addEventListener("keydown", (event) => {
    if (!keys[event.key] || isShortcut(event)) return;
    event.preventDefault();
    keys[event.key]();
  });
}
