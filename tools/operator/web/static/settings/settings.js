// All that can be set: the everyday things by hand, everything else from the table of topics.

import { button, el } from "../dom.js";
import { FRAME_NAMES } from "../choices.js";
import { createAxes } from "./axes.js";
import { createForm } from "./form.js";
import { createLinks } from "./links.js";
import { createShares } from "./shares.js";
import { createSources } from "./sources.js";

// Have a better control elsewhere, or are no setting: lease, streams, the beat of the lease.
const ELSEWHERE = ["cmd/keepalive", "cmd/joystick", "cmd/jog", "cmd/self_motion", "cmd/drive", "cmd/master_pose",
  "operator/lease", "operator/release", "operator/protective_stop", "operator/protective_clear",
  "operator/free_axes", "operator/virtual_links", "operator/load_shares"];

export function createSettings(element, catalogue, { ask, choices }) {
  const sources = el("div", {});
  const axes = el("div", {});
  const held = createAxes(axes, { ask, choices });
  const ways = el("div", {});
  const links = createLinks(ways, { ask, choices });
  const load = el("div", {});
  const shares = createShares(load, { ask, choices });
  const objectives = el("div", {});
  const list = createSources(sources, { ask, choices, units: catalogue.gain_units });
  const quick = [];

  // A button that sends one request, with the place for its refusal.
  function act(text, key, fields, named = "task", title = "") {
    const refusal = el("span", { className: "refusal", role: "status" });
    quick.push(key);
    return [button(text, () => ask(key, { ...fields, ...choices[named] }, refusal), title ? { title } : {}), refusal];
  }
  const row = (...acts) => el("div", { className: "row" }, ...acts.map(([each]) => each), ...acts.map(([, refusal]) => refusal));

  element.append(
    el("h2", {}, "Sources: switch and gains"), sources,
    el("h2", {}, "Tool"),
    row(act("Tare", "operator/tare", {}, "mechanism"), act("Close gripper", "operator/gripper", { closed: true }, "mechanism"),
      act("Open gripper", "operator/gripper", { closed: false }, "mechanism")),
    row(act("The load is known", "operator/acknowledge_load", {}, "mechanism"), act("Store the view", "operator/store_view", {})),
    row(act("Keep it by its picture", "operator/store_view", { again: true, law: "image" }), act("by its pose", "operator/store_view", { again: true, law: "pose" })),
    el("div", { hidden: true }, el("h2", {}, "Load of the payload"), load),
    el("h2", {}, "Frames"),
    row(act("Reference here", "operator/frame", { frame: "crf", relative_to: "mrf" }, "task", FRAME_NAMES.crf[1]),
      act("Tool to the reference", "operator/frame", { frame: "mrf", relative_to: "crf" }, "task", FRAME_NAMES.mrf[1]),
      act("Tool to the wrist", "operator/frame", { frame: "mrf" }, "task", FRAME_NAMES.mrf[1])),
    el("h2", {}, "Path"),
    row(act("Pause", "operator/path", { action: "pause" }), act("Go on", "operator/path", { action: "resume" }), act("Abort", "operator/path", { action: "abort" })),
    el("h2", {}, "Cell"),
    row(act("Clearances on", "operator/avoidance", { on: true }, "none"), act("off", "operator/avoidance", { on: false }, "none")),
    row(act("Hold together", "operator/hold_together", { on: true }, "none"), act("Let go", "operator/hold_together", { on: false }, "none")),
    el("h2", {}, "Axes of the tool that the task holds"), axes,
    el("div", { hidden: true }, el("h2", {}, "Virtual links"), ways),
    el("h2", {}, "Redundancy"), objectives,
    el("h2", {}, "Everything else"),
    ...catalogue.topics.filter(({ key }) => !ELSEWHERE.includes(key)).map((topic) => {
      const form = el("details", { className: "card" }, el("summary", {}, topic.key.split("/")[1].replaceAll("_", " ")));
      form.dataset.topic = topic.key;
      form.addEventListener("toggle", () => form.open && form.childElementCount === 1 && form.append(createForm(topic, { ask, choices })));
      return form;
    }),
  );

  let listed = "";
  function listObjectives(own) {
    const names = Object.keys(own.objectives);
    if (names.join() === listed) return;
    listed = names.join();
    objectives.replaceChildren(...names.map((objective) => {
      const refusal = el("span", { className: "refusal", role: "status" });
      const gain = el("input", { type: "text", inputMode: "decimal", size: 6, "aria-label": `${objective} gain`, value: own.objectives[objective][0] });
      const set = () => ask("operator/redundancy", { objective, gain: Number(gain.value.replace(",", ".")), ...choices.task }, refusal);
      return el("div", { className: "row" }, el("span", { className: "grow" }, objective.replaceAll("_", " ")), gain, button("Set", set), refusal);
    }));
  }

  return {
    update() {
      list.update();
      held.update();
      links.update();
      shares.update();
      if (choices.shown) listObjectives(choices.shown);
    },
  };
}
