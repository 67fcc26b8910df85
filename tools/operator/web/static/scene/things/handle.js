/** The handle at the MRF: dragged, it is a target; let go of, it goes back to the tool. */

import { TransformControls } from "../../vendor/TransformControls.js";
import { triad } from "./frames.js";
import { THREE, place } from "../stage/kit.js";
import { toRpy } from "../geometry/poses.js";

export function createHandle(description, materials, stage, scale) {
  const object = new THREE.Group();
  const grip = new THREE.Group();
  const ghost = triad(0.11 * scale, materials, 0.55);
  ghost.visible = false;
  object.add(grip, ghost);
  const controls = new TransformControls(stage.camera, stage.canvas);
  controls.setSize(0.62);
  controls.attach(grip);
  const helper = controls.getHelper();
  helper.visible = controls.enabled = false;
  object.add(helper);
  const callbacks = new Set();
  let mode = null;
  let task = 0;
  let dragging = false;
  let abandoned = false;

  const pose = () => [...grip.position.toArray(), ...grip.quaternion.toArray()];
  function tell(phase) {
    const message = {
      type: "target", phase, released: phase === "end",
      task: description.tasks[task].name, pose: toRpy(pose()),
    };
    for (const callback of callbacks) callback(message);
  }
  controls.addEventListener("change", stage.invalidate);
  controls.addEventListener("dragging-changed", ({ value }) => {
    dragging = value;
    stage.controls.enabled = !value;
    ghost.visible = value;
    tell(value ? "start" : abandoned ? "abandoned" : "end");
  });
  controls.addEventListener("objectChange", () => {
    place(ghost, pose());
    tell("move");
  });

  /** End a drag that leads nowhere: the handle goes back to the tool, though it is still pressed. */
  function abandon() {
    if (!dragging) return;
    abandoned = true;
    controls.pointerUp(null);
    abandoned = false;
  }

  return {
    object,
    abandon,
    onTarget(callback) {
      callbacks.add(callback);
      return () => callbacks.delete(callback);
    },
    /** Show the handle to move or to turn the target of a task; null hides it and ends a drag. */
    setMode(next, name = null) {
      mode = next === "rotate" || next === "translate" ? next : null;
      const found = description.tasks.findIndex((t) => t.name === name);
      task = found < 0 ? 0 : found;
      if (mode) controls.setMode(mode);
      else abandon();
      controls.enabled = mode !== null;
      helper.visible = mode !== null;
      stage.invalidate();
    },
    setSpace(space) { controls.setSpace(space === "world" ? "world" : "local"); },
    dragging: () => dragging,
    /** Where the handle is on the screen, from the canvas' corner [px]. */
    onScreen() {
      const [width, height] = stage.size();
      stage.camera.updateMatrixWorld();
      const at = grip.getWorldPosition(new THREE.Vector3()).project(stage.camera);
      return [0.5 * (at.x + 1) * width, 0.5 * (1 - at.y) * height];
    },
    pose(view) {
      const { mrf } = view.tasks[task];
      if (mrf && !dragging) place(grip, mrf);
      if (mode) helper.updateMatrixWorld();
    },
    dispose() {
      controls.detach();
      controls.dispose();
    },
  };
}
