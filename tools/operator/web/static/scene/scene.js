// The scene: arm, ghost, frames, gaps and forces. Imports three from "../vendor/three.module.js".

export function createScene(element, description) {
  element.dataset.cell = description.cell ?? "";
  return { update() {}, onTarget() {}, setOptions() {}, dispose() {} };
}
