// The page of a recorded run: the scene and the panels as they were at a time that can be chosen.

import { createCameras } from "../cameras/cameras.js";
import { Choices } from "../choices.js";
import { el, setClass, setText } from "../dom.js";
import { createNow } from "../panels/now.js";
import { createTabs } from "../panels/tabs.js";
import { createView } from "../panels/view.js";
import { severityOf } from "../panels/why.js";
import { createPlots } from "../plots/plots.js";
import { sceneIn } from "../scenery.js";
import { createEvents } from "./events.js";
import { createLine } from "./line.js";
import { createPlayer } from "./player.js";

const EVERY_MS = 40;
/** The state that an event led to is told a tick or two later [s]. */
const AFTER_S = 0.02;
const at = (id) => document.getElementById(id);
const read = async (name) => {
  const answer = await fetch(name);
  if (!answer.ok) throw new Error(`${name}: ${answer.status}`);
  return answer.json();
};

const [description, run] = await Promise.all([read("scene.json"), read("run.json")]);
const told = new EventTarget();
const choices = new Choices(told);
const scene = sceneIn(at("scene"), description);
scene.setOptions({ handle: null });
const cameras = createCameras(at("scene"), description, null);
at("scene").addEventListener("cameras", ({ detail }) => scene.setOptions({ covered: detail }));
const mode = el("span", { className: "mode" }, "…");
at("bar").append(el("span", { className: "mark" }, el("img", { src: "icon.svg", alt: "" }), run.cell), mode,
  el("span", { className: "fact" }, "recorded run", el("b", {}, run.name)));
const sentence = el("p", {}, "");
const box = at("side").appendChild(el("div", { className: "why", role: "status" }, sentence));
const panels = createTabs(at("side"), ["Events", "Now"]);
const now = createNow(panels.Now, choices);
const plots = createPlots(at("plots"), description);
const player = createPlayer({
  length: run.length_s, pieceLength: run.piece_s, load: (i) => read(`pieces/${i}.json`), show,
});
const events = createEvents(panels.Events, run.events, (t) => player.seek(t + AFTER_S));
const line = createLine(at("line"), player, run.events);
scene.views.then((views) => views && createView(at("view"), scene, views));
document.title = `${run.name} · telerobot`;

let newest = null;

function show(messages) {
  const states = messages.filter((message) => message.type === "state");
  for (const message of messages) {
    if (message.type === "picture") cameras.show(message.picture);
    else if (message.type !== "state") scene.update(message);
  }
  const contour = messages.filter((message) => message.type === "contour").at(-1);
  if (contour) now.ahead(contour.contour);
  if (!states.length) return;
  for (const state of states) plots.update(state);
  newest = states.at(-1);
  told.dispatchEvent(new CustomEvent("state", { detail: newest }));
  scene.jump(newest.state);
  setText(mode, newest.state.mode);
  setClass(mode, `mode ${newest.state.mode}`);
  setText(sentence, newest.why.sentence);
  setClass(box, `why ${severityOf(newest.state)}`);
  document.body.dataset.shown = newest.t;
}

let last = performance.now();
setInterval(() => {
  const at = performance.now();
  player.step((at - last) / 1000);
  last = at;
  line.update();
  events.update(player.time);
  if (newest) now.update(newest);
}, EVERY_MS);
document.body.dataset.ready = "true";
