// The handle at the MRF: a target that is sent on release, or followed live through the clutch.

import { button, el } from "../dom.js";

export function createDrag(element, { link, held, choices, ask, scene, refusal }) {
  const modes = [["Off", null], ["Move", "translate"], ["Turn", "rotate"]];
  const buttons = modes.map(([text, mode]) => button(text, () => choose(mode), { "aria-pressed": String(mode === null) }));
  const live = el("input", { type: "checkbox", id: "drag-live" });
  element.append(el("div", { className: "row" }, "handle", ...buttons,
    live, el("label", { htmlFor: "drag-live" }, "live")));
  let mode = null;
  let following = false;

  function choose(chosen) {
    mode = chosen;
    buttons.forEach((each, i) => each.setAttribute("aria-pressed", String(modes[i][1] === mode)));
    show();
  }

  const show = () => scene.setOptions({ handle: mode, task: choices.led?.task ?? null });
  choices.addEventListener("change", show);

  const pose = ([x, y, z, ...rpy]) => ({ xyz: [x, y, z], rpy });
  const follow = (at) => held.stream("cmd/master_pose", { ...pose(at), expressed_in: "world", ...choices.task });

  async function engage(at) {
    following = true;
    choices.aboutToMove();
    const reply = await ask("operator/clutch", { engaged: true, translation: 1, rotation: 1, ...choices.task }, refusal);
    if (reply.ok && following) follow(at);
    else following = false;
  }

  function disengage() {
    if (!following) return;
    following = false;
    held.stream("cmd/master_pose", null);
    // Let go at once, not when the daemon's timeout is over; engaged again, for the stick.
    for (const engaged of [false, true]) link.send("operator/clutch", { engaged, ...choices.task });
  }

  held.onEnd(disengage);
  scene.onTarget(({ phase, pose: at }) => {
    if (live.checked) {
      if (phase === "start") engage(at);
      else if (phase === "move" && following) follow(at);
      else if (phase === "end") disengage();
    } else if (phase === "end") {
      choices.posture = false;
      ask("cmd/position", { ...pose(at), relative_to: "world", ...choices.task }, refusal);
    }
  });
}
