/** A still of a run for a picture: all its states one after the other, then what the last one shows. */

import { createCameras } from "../cameras/cameras.js";
import { createScene } from "./scene.js";

const asked = new URLSearchParams(globalThis.location.search);
const [description, run] = await Promise.all(
  ["description.json", "run.json"].map(async (name) => (await fetch(name)).json()),
);
const scene = createScene(document.getElementById("scene"), description, { fine: true });
scene.setOptions({ theme: asked.get("theme") ?? "dark" });
scene.setOptions({ view: asked.get("view") ?? "home", easing: false });
scene.setOptions({ handle: asked.get("handle") });
for (const state of run.states) scene.jump(state);
const cameras = createCameras(document.getElementById("scene"), description, null);
for (const message of run.news) {
  if (message.type === "picture") await cameras.show(message.picture);
  else scene.update(message);
}
if (run.states.length) scene.jump(run.states.at(-1));
await scene.loaded;
scene.setOptions({ view: asked.get("view") ?? "home", easing: false });
globalThis.scene = scene;
do await new Promise((done) => { setTimeout(done, 600); }); while (!scene.upToDate());
document.body.dataset.ready = "true";
