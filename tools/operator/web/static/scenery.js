// The scene where the browser can draw it; else words in its place, and everything else goes on.
//
// It is loaded and made once everything else is there: without a graphics card that takes seconds,
// in which the arm can be stopped and steered already. There it is drawn plainly, unless the page's
// address says `?fine`.

import { el, setText } from "./dom.js";

const KEPT = ["obstacle"];

export function sceneIn(element, description) {
  const options = {};
  const news = [];
  const newest = new Map();
  const callbacks = [];
  let scene = null;
  const waiting = element.querySelector(".waiting");
  const told = description.missing.length ? element.appendChild(undrawn(description.missing)) : null;

  async function make() {
    if (waiting) setText(waiting, "Drawing the scene…");
    if (!document.createElement("canvas").getContext("webgl2")) {
      waiting?.remove();
      told?.remove();
      element.append(el("p", { className: "unseeable" }, "The scene cannot be drawn: this browser has no WebGL. Everything else works."));
      return null;
    }
    const { VIEWS, createScene } = await import("./scene/scene.js");
    const made = createScene(element, description, { fine: new URLSearchParams(location.search).has("fine") });
    for (const callback of callbacks) made.onTarget(callback);
    made.setOptions(options);
    const still = newest.get("jump");
    newest.delete("jump");
    for (const message of [...newest.values(), ...news.splice(0)]) made.update(message);
    if (still) made.jump(still);
    newest.clear();
    scene = made;
    made.loaded.then(() => waiting?.remove());
    return VIEWS;
  }

  return {
    /** Resolves with the names of the views once the scene is there, with null if there is none. */
    views: new Promise((resolve) => { setTimeout(resolve); }).then(make),
    update(message) {
      if (scene) scene.update(message);
      else if (KEPT.includes(message.type)) news.push(message);
      else newest.set(message.type, message);
    },
    /** Show a state at once, without interpolation: of a recorded run. */
    jump(state) {
      if (scene) scene.jump(state);
      else newest.set("jump", state);
    },
    onTarget: (callback) => (scene ? scene.onTarget(callback) : callbacks.push(callback)),
    setOptions: (given) => (scene ? scene.setOptions(given) : Object.assign(options, given)),
    abandon: () => scene?.abandon(),
    leadTo: (handle, tool) => scene.leadTo(handle, tool),
    handleOnScreen: () => scene?.handleOnScreen() ?? [0, 0],
  };
}

/** Return a note that names the meshes which cannot be drawn, and why. */
function undrawn(missing) {
  const note = el("details", { className: "undrawn" });
  const many = missing.length === 1 ? "A mesh" : `${missing.length} meshes`;
  note.append(el("summary", {}, `${many} cannot be drawn: collision shapes or capsules stand for it`));
  for (const { link, mesh, why } of missing.slice(0, 20)) note.append(el("p", {}, `${link}: ${mesh}: ${why}`));
  return note;
}
