// The page: one link to the console, panels around the scene, and everything held in one place.

import { createCameras } from "./cameras/cameras.js";
import { Choices, FRAMES } from "./choices.js";
import { el, setText } from "./dom.js";
import { Held } from "./held.js";
import { Link } from "./link.js";
import { createBar } from "./panels/bar.js";
import { createLog } from "./panels/log.js";
import { createNow } from "./panels/now.js";
import { createStop } from "./panels/stop.js";
import { createTabs } from "./panels/tabs.js";
import { createView } from "./panels/view.js";
import { createWhy } from "./panels/why.js";
import { createPlots } from "./plots/plots.js";
import { sceneIn } from "./scenery.js";
import { asker } from "./settings/ask.js";
import { createSettings } from "./settings/settings.js";
import { steerByKeys } from "./steering/keys.js";
import { createPads } from "./steering/pads.js";
import { createSteer } from "./steering/steer.js";

const SILENT_MS = 400;
const DRAWN_MS = 66;
/** On a slow network the first state comes after all that the scene is drawn of. */
const FIRST_MS = 5000;
const at = (id) => document.getElementById(id);
const read = async (name) => (await fetch(name)).json();

const [description, catalogue] = await Promise.all([read("scene.json"), read("catalogue.json")]);
const name = localStorage.getItem("name") ?? "";
const link = new Link(name);
const choices = new Choices(link);
const held = new Held(link, choices);
const ask = asker(link);
const scene = sceneIn(at("scene"), description);
const cameras = createCameras(at("scene"), description, link);
const plots = createPlots(at("plots"), description);
const bar = createBar(at("bar"), { link, cell: catalogue.cell, name, ask });
const why = createWhy(at("side"), ask);
const panels = createTabs(at("side"), ["Steer", "Now", "Set", "Log"]);
const steer = createSteer(panels.Steer, { link, held, choices, ask, scene });
const now = createNow(panels.Now, choices);
const settings = createSettings(panels.Set, catalogue, { ask, choices });
const log = createLog(panels.Log);
const stop = createStop(at("stop"), ask);
scene.views.then((views) => views && createView(at("view"), scene, views));
createPads(at("hand"), held);
Object.assign(at("scene"), { handleOnScreen: scene.handleOnScreen, setOptions: scene.setOptions });
document.title = `${catalogue.cell} · telerobot`;

let role = "operator";
let holds = false;
let newest = null;
/** For so long this page has run without a state [ms]. */
let unheard = 0;
let drawnAt = performance.now();

const mode = (action) => () => ask("operator/mode", { action });

// Where nobody has the lease, enabling takes it first: as in the terminal.
async function enable() {
  if (holds || (await ask("operator/lease", {})).ok) ask("operator/mode", { action: "enable" });
}

steerByKeys(held, choices, {
  stop: stop.press,
  m: enable, h: mode("hold"), n: mode("disable"), R: mode("reset"),
  c: () => ask("operator/protective_clear", {}), L: () => ask("operator/lease", {}),
  t: () => ask("operator/tare", choices.mechanism),
  e: () => choices.choose({ frame: FRAMES[(FRAMES.indexOf(choices.frame) + 1) % FRAMES.length] }),
  p: () => {
    choices.posture = true;
    ask("cmd/posture", { posture: "ready", ...choices.mechanism });
  },
  "+": () => choices.choose({ level: choices.level + 1 }), "-": () => choices.choose({ level: choices.level - 1 }),
});

let reached = true;

link.addEventListener("link", ({ detail }) => {
  ({ role } = detail);
  reached = detail.daemon !== "silent";
  document.body.dataset.role = role;
});
link.addEventListener("state", ({ detail }) => {
  const { state } = detail;
  const mine = detail.mine;
  if (holds && !mine) held.endAll();
  if (newest && newest.state.mode === "enabled" && state.mode !== "enabled") held.endAll();
  holds = mine;
  newest = detail;
  unheard = 0;
  scene.update(detail);
  plots.update(detail);
});
for (const type of ["truth", "obstacle", "contour", "scan"]) link.addEventListener(type, ({ detail }) => scene.update(detail));
link.addEventListener("picture", ({ detail }) => cameras.show(detail.picture));
link.addEventListener("lapsed", () => why.remark("What was held has ended: this page stood still, or lost control. Let go, and hold it again."));
at("scene").addEventListener("cameras", ({ detail }) => scene.setOptions({ covered: detail }));
link.addEventListener("contour", ({ detail }) => now.ahead(detail.contour));
link.addEventListener("event", ({ detail }) => {
  log.add(detail);
  plots.update(detail);
});

// Panels are drawn fifteen times a second, from the newest state; the scene interpolates by itself.
const over = at("over").appendChild(el("p", { hidden: true }));
function draw() {
  // Where the page itself stood still, states wait to be read: that is no silence of the daemon.
  const time = performance.now();
  unheard += Math.min(time - drawnAt, 2 * DRAWN_MS);
  drawnAt = time;
  const silent = !reached || unheard > (newest ? SILENT_MS : FIRST_MS);
  if (!newest && !silent) return;
  over.hidden = !silent;
  document.body.classList.toggle("silent", silent);
  if (silent) {
    const what = link.open ? ["The daemon is silent.", "Start it again, or look at its link; this page goes on by itself."]
      : ["The console does not answer.", "It is dialled again and again; look at its terminal."];
    why.say(...what, "error");
    why.offer([], "");
    setText(over, what[0]);
    bar.silent(link.open ? "no daemon" : "no console");
  } else {
    for (const panel of [bar, steer, now, settings, stop]) panel.update(newest, holds);
    why.update(newest, holds, role !== "operator");
  }
}
setInterval(draw, DRAWN_MS);
document.body.dataset.ready = "true";
