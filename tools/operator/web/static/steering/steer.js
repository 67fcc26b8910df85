// The panel to steer by: axes, speed, target, postures, joints, gamepad and SpaceMouse.

import { FRAMES, FRAME_NAMES, SPEEDS } from "../choices.js";
import { button, el, setText } from "../dom.js";
import { createDrag } from "./drag.js";
import { createGamepad } from "./gamepad.js";
import { createJog } from "./jog.js";
import { createSpare } from "./spare.js";
import { createSpaceMouse } from "./spacemouse.js";

export function createSteer(element, { link, held, choices, ask, scene }) {
  const refusal = el("span", { className: "refusal", role: "status" });
  const frame = el("select", { "aria-label": "Axes of the stick", onchange: () => choices.choose({ frame: frame.value }) },
    ...FRAMES.map((name) => el("option", { value: name, title: FRAME_NAMES[name][1] }, FRAME_NAMES[name][0])));
  const level = el("input", { type: "range", min: 0, max: SPEEDS.length - 1, step: 1, "aria-label": "Speed of the stick", className: "grow",
    oninput: () => choices.choose({ level: Number(level.value) }) });
  const speed = el("output", { className: "mono" });
  const arm = el("select", { "aria-label": "Arm that is led", onchange: () => {
    held.endAll();
    choices.choose({ hand: arm.selectedIndex, posture: false });
  } });
  const armRow = el("div", { className: "row", hidden: true }, el("span", { className: "dim" }, "arm"), arm);
  const postures = el("div", { className: "row" });
  const driving = el("div", { className: "row" });
  const spares = el("div", {});
  let driven = null;
  const joints = el("div", {});
  const pad = el("div", {});
  const mouse = el("div", {});
  const target = el("div", {});
  const jog = createJog(joints, held, choices);
  const spare = createSpare(spares, held, choices);
  const drag = createDrag(target, { link, held, choices, ask, scene, refusal });
  createGamepad(pad, held);
  createSpaceMouse(mouse, held);
  element.append(
    el("h2", {}, "Stick"), armRow,
    el("div", { className: "row" }, el("span", { className: "dim" }, "axes"), frame, level, speed), driving, spares,
    el("h2", {}, "Target"), target, el("h2", {}, "Postures"), postures, refusal,
    el("h2", {}, "Joints"), joints, el("h2", {}, "Gamepad"), pad, el("h2", {}, "SpaceMouse"), mouse,
    el("h2", {}, "Keys"), keys(),
  );

  function move(posture) {
    choices.posture = true;
    ask("cmd/posture", { posture, ...choices.mechanism }, refusal);
  }

  function drive(text, ahead, turn) {
    const tell = (on) => held.stream("cmd/drive", on ? choices.drive(ahead, turn) : null);
    const act = button(text, () => {}, { onpointerdown: () => tell(true), title: "while held" });
    for (const name of ["pointerup", "pointercancel", "pointerleave"]) act.addEventListener(name, () => tell(false));
    return act;
  }

  function drives(led) {
    if (led?.insertion) return [drive("Insert", 1, 0), drive("Withdraw", -1, 0)];
    if (led?.base) return [drive("Ahead", 1, 0), drive("Back", -1, 0), drive("Left", 0, 1), drive("Right", 0, -1)];
    return [];
  }

  function show() {
    frame.value = choices.frame;
    frame.title = FRAME_NAMES[choices.frame][1];
    level.value = choices.level;
    setText(speed, `${choices.speed * 1000} mm/s`);
    arm.selectedIndex = choices.hand;
  }

  choices.addEventListener("described", () => {
    arm.replaceChildren(...choices.tasks.map(({ task }) => el("option", {}, task)));
    armRow.hidden = choices.tasks.length < 2;
  });
  choices.addEventListener("change", () => {
    const led = choices.led;
    postures.replaceChildren(
      ...Object.keys(led?.postures ?? {}).map((name) => button(name, () => move(name))),
      button("Cancel goals", () => ask("cmd/cancel", choices.task, refusal)));
    if (led !== driven) {
      // Buttons that are taken away hear no release: what they hold ends with them.
      held.stream("cmd/drive", null);
      driving.replaceChildren(...drives(led));
      driven = led;
    }
    show();
  });
  show();
  return { update({ state }) {
    jog.update(state);
    spare.update();
    drag.update();
  } };
}

function keys() {
  const rows = [
    ["w s · a d · r f", "move along x, y, z"], ["u o · i k · j l", "turn about x, y, z"],
    ["+ −", "faster, slower"], ["e", "next axes"], ["m · h · n", "enable, hold, drives off"],
    ["L", "take control (the lease)"], ["p", "ready posture"], ["v b", "insert, withdraw; drive ahead, back"], [", .", "turn the base left, right"], ["c · R", "clear the stop, reset"], ["Esc", "let go of all that is held"], ["space", "protective stop"],
  ];
  return el("div", {}, ...rows.map(([key, does]) => el("div", { className: "row" }, el("kbd", {}, key), el("span", { className: "dim" }, does))));
}
