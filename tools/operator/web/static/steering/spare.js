// The slider of the spare joints, which springs back: the elbow turns, and the tool stays.

import { el, fixed, setText } from "../dom.js";

export function createSpare(element, held, choices) {
  const angle = el("output", { className: "mono" });
  const slider = el("input", { type: "range", min: -1, max: 1, step: 0.02, value: 0,
    "aria-label": "Self-motion", className: "grow", oninput: tell });
  const row = el("div", { className: "row", title: "moves the spare joints; the tool stays" }, el("span", { className: "dim" }, "elbow"), slider, angle);

  // Of the arm angle as fast as the tool turns, or so much of the quickest.
  function most() {
    const told = choices.led?.self_motion;
    return told ? Math.min(choices.turn, told.arm_angle ?? told.share) : 0;
  }

  function tell() {
    const rate = Number(slider.value) * most();
    held.stream("cmd/self_motion", rate ? { rate, ...choices.mechanism } : null);
  }

  function back() {
    slider.value = 0;
    tell();
  }

  for (const event of ["pointerup", "pointercancel", "keyup", "blur", "change"]) slider.addEventListener(event, back);
  choices.addEventListener("change", () => (row.hidden = !most()));
  held.onEnd(() => (slider.value = 0));
  element.append(row);
  row.hidden = true;
  return {
    update() {
      if (row.hidden) return;
      const phi = choices.own?.arm_angle;
      setText(angle, Number.isFinite(phi) ? `φ ${fixed((phi * 180) / Math.PI, 1)}°` : "");
    },
  };
}
