// Which axes of its MRF the task holds; those that it leaves free are the null space's.

import { el } from "../dom.js";

export const AXES = ["x", "y", "z", "rx", "ry", "rz"];
const FADED_MS = 1000; // so long after a request the boxes show what was asked for, then what is

export function createAxes(element, { ask, choices }) {
  const refusal = el("span", { className: "refusal", role: "status" });
  const boxes = AXES.map((axis) => el("input", { type: "checkbox", id: `held-${axis}`, checked: true }));
  let asked = null;
  let until = 0;

  async function change() {
    const axes = AXES.filter((_, i) => !boxes[i].checked);
    [asked, until] = [axes, performance.now() + FADED_MS];
    const reply = await ask("operator/free_axes", { axes, ...choices.task }, refusal);
    if (!reply.ok && asked === axes) asked = null;
  }

  boxes.forEach((box) => box.addEventListener("change", change));
  element.append(
    el("div", { className: "row", title: "an axis that is not held is left to the spare joints" },
      ...boxes.flatMap((box, i) => [box, el("label", { htmlFor: box.id, className: "mono" }, AXES[i])])),
    refusal,
  );
  choices.addEventListener("change", () => { asked = null; });

  return {
    update() {
      const held = choices.shown?.axes_held;
      if (!held || element.offsetParent === null) return;
      if (performance.now() > until) asked = null;
      boxes.forEach((box, i) => {
        box.checked = asked ? !asked.includes(AXES[i]) : held[i] > 0;
        box.indeterminate = held[i] > 0 && held[i] < 1;
      });
    },
  };
}
