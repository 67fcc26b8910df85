// Joint sliders that spring back, and where each joint is between its bounds.

import { el, fixed, setText } from "../dom.js";

export function createJog(element, held, choices) {
  let joints = [];

  function tell() {
    const bounds = choices.led.max_velocity;
    const rates = joints.map(({ slider }, i) => Number(slider.value) * Math.min(choices.turn, bounds[i]));
    const moves = rates.some((rate) => rate !== 0);
    if (moves && !held.jogging) choices.aboutToMove();
    held.jogging = moves;
    held.stream("cmd/jog", moves ? { rates, ...choices.mechanism } : null);
  }

  function build() {
    joints = (choices.led?.joints ?? []).map((name) => {
      const slider = el("input", { type: "range", min: -1, max: 1, step: 0.02, value: 0,
        "aria-label": `Jog ${name}`, oninput: tell });
      const back = () => {
        slider.value = 0;
        tell();
      };
      for (const event of ["pointerup", "pointercancel", "keyup", "blur", "change"]) slider.addEventListener(event, back);
      const place = el("i");
      const angle = el("output", { className: "mono" });
      const row = el("div", { className: "joint" }, el("span", { title: name }, short(name)), slider, angle,
        el("div", { className: "range", "aria-hidden": "true" }, place));
      return { slider, place, angle, row };
    });
    element.replaceChildren(...joints.map(({ row }) => row));
  }

  /** Return a joint's name without what all names of the arm begin with; its end matters most. */
  function short(name) {
    const names = choices.led.joints;
    let common = names[0];
    while (common && names.some((each) => !each.startsWith(common))) common = common.slice(0, -1);
    const cut = Math.max(0, ...["_", "-", ".", "/", " "].map((mark) => common.lastIndexOf(mark) + 1));
    return names.length > 1 ? name.slice(cut) : name;
  }

  choices.addEventListener("described", build);
  choices.addEventListener("change", () => joints.length !== (choices.led?.joints.length ?? 0) && build());
  held.onEnd(() => joints.forEach(({ slider }) => (slider.value = 0)));
  return {
    update(state) {
      if (!choices.led || element.offsetParent === null) return;
      const { lower, upper, slides } = choices.led;
      joints.forEach(({ place, angle }, i) => {
        const q = state.q[choices.firstJoint + i];
        if (q === null || q === undefined) return;
        setText(angle, slides?.[i] ? `${fixed(1000 * q, 0)} mm` : `${fixed((q * 180) / Math.PI, 1)}°`);
        place.style.left = `${Math.max(0, Math.min(1, (q - lower[i]) / (upper[i] - lower[i]))) * 100}%`;
      });
    },
  };
}
