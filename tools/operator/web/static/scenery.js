// The scene where the browser can draw it; else words in its place, and everything else goes on.

import { el } from "./dom.js";
import { createScene } from "./scene/scene.js";

const NOTHING = { update() {}, onTarget() {}, setOptions() {}, dispose() {}, handleOnScreen: () => [0, 0] };

export function sceneIn(element, description) {
  if (document.createElement("canvas").getContext("webgl2")) return createScene(element, description);
  element.append(el("p", { className: "unseeable" }, "The scene cannot be drawn: this browser has no WebGL. Everything else works."));
  return NOTHING;
}
