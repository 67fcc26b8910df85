// The handle at the MRF: a target that is sent on release, or followed live through the clutch.

import { button, el } from "../dom.js";

const LEAD_MS = 20;
/** The daemon leads by how the pose changes: so many times, and until it leads, it is told the tool's own. */
const FIRST = 5;
const HELP = "Drag the handle: the tool goes there once you let go. Live, it follows while you drag, "
  + "and stands once you let go. Esc drops it.";

export function createDrag(element, { link, held, choices, ask, scene, refusal }) {
  const modes = [["Off", null], ["Move", "translate"], ["Turn", "rotate"]];
  const buttons = modes.map(([text, mode]) => button(text, () => choose(mode), { "aria-pressed": String(mode === null) }));
  const live = el("input", { type: "checkbox", id: "drag-live", onchange: () => scene.abandon() });
  element.append(el("div", { className: "row" }, "handle", ...buttons,
    live, el("label", { htmlFor: "drag-live" }, "live")), el("p", { className: "dim" }, HELP));
  let mode = null;
  let task = null;
  let handle = null;
  let leading = null;

  function choose(chosen) {
    mode = chosen;
    buttons.forEach((each, i) => each.setAttribute("aria-pressed", String(modes[i][1] === mode)));
    show();
  }

  // The task that is led: the payload's own while arms hold it together.
  const led = () => choices.task.task ?? choices.led?.task ?? null;
  function show() {
    task = led();
    scene.setOptions({ handle: mode, task });
  }
  choices.addEventListener("change", show);

  const pose = ([x, y, z, ...rpy]) => ({ xyz: [x, y, z], rpy });

  async function engage() {
    let engaged = false;
    let times = 0;
    const mine = setInterval(() => {
      const { pose_mrf: tool, target_mrf: target } = choices.shown ?? {};
      if (!engaged || mine !== leading || !tool) return;
      times += 1;
      const at = times > FIRST && target ? scene.leadTo(handle, tool) : tool;
      held.stream("cmd/master_pose", { ...pose(at), expressed_in: "world", ...choices.task });
    }, LEAD_MS);
    leading = mine;
    choices.aboutToMove();
    const reply = await ask("operator/clutch", { engaged: true, translation: 1, rotation: 1, ...choices.task }, refusal);
    engaged = reply.ok;
    if (!engaged && mine === leading) disengage();
  }

  function disengage() {
    if (leading === null) return;
    clearInterval(leading);
    leading = null;
    held.stream("cmd/master_pose", null);
    // Let go at once, not when the daemon's timeout is over; engaged again, for the stick.
    for (const engaged of [false, true]) link.send("operator/clutch", { engaged, ...choices.task });
  }

  // A drag is held, too: what was dragged so far is no target once it ends by itself.
  held.onEnd(() => scene.abandon());
  scene.onTarget(({ phase, pose: at }) => {
    handle = at;
    if (phase === "abandoned") disengage();
    else if (live.checked) {
      if (phase === "start") engage();
      else if (phase === "end") disengage();
    } else if (phase === "end") {
      choices.posture = false;
      ask("cmd/position", { ...pose(at), relative_to: "world", ...choices.task }, refusal);
    }
  });
  return { update() {
    if (task === led()) return;
    scene.abandon();
    show();
  } };
}
