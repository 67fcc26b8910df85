// The on-screen stick: two round fields with a strip each, for thumbs as for a mouse.

import { el } from "../dom.js";

const DEAD = 0.1;

const part = (value) => {
  const size = Math.abs(value) < DEAD ? 0 : (Math.abs(value) - DEAD) / (1 - DEAD);
  return Math.sign(value) * Math.min(1, size);
};

// One field: `moved` gets [right, up], each from -1 to 1, or null when it is let go of.
function field(className, label, axes, moved) {
  const knob = el("div", { className: "knob" });
  const names = axes.map(([side, text]) => el("span", { className: `axis ${side}` }, text));
  const pad = el("div", { className, role: "img", "aria-label": label }, ...names, knob);
  const strip = className.includes("strip");
  let pointer = null;

  function place(event) {
    const box = pad.getBoundingClientRect();
    let right = strip ? 0 : (2 * (event.clientX - box.left)) / box.width - 1;
    let up = 1 - (2 * (event.clientY - box.top)) / box.height;
    const far = Math.max(1, Math.hypot(right, up));
    [right, up] = [right / far, up / far];
    knob.style.translate = `${(right * box.width) / 2.6}px ${(-up * box.height) / 2.6}px`;
    moved([part(right), part(up)]);
  }

  function end() {
    if (pointer === null) return;
    pointer = null;
    pad.classList.remove("held");
    knob.style.translate = "0 0";
    moved(null);
  }

  pad.addEventListener("pointerdown", (event) => {
    if (pointer !== null) return;
    pointer = event.pointerId;
    pad.setPointerCapture(pointer);
    pad.classList.add("held");
    place(event);
  });
  pad.addEventListener("pointermove", (event) => event.pointerId === pointer && place(event));
  for (const name of ["pointerup", "pointercancel", "lostpointercapture"]) {
    pad.addEventListener(name, (event) => event.pointerId === pointer && end());
  }
  pad.addEventListener("contextmenu", (event) => event.preventDefault());
  return { pad, end };
}

function pair(held, name, caption, [forward, left, up]) {
  const parts = [0, 0, 0, 0, 0, 0];
  const tell = (axes, values) => {
    axes.forEach((axis, i) => (parts[axis] = values[i]));
    held.twist(name, [...parts]);
  };
  const round = field("field", `${caption}: plane`, [["up", `+${forward.name}`], ["left", `+${left.name}`]],
    (moved) => tell([forward.axis, left.axis], moved ? [moved[1], -moved[0]] : [0, 0]));
  const strip = field("field strip", `${caption}: third axis`, [["up", `+${up.name}`]],
    (moved) => tell([up.axis], [moved ? moved[1] : 0]));
  held.onEnd(() => {
    parts.fill(0);
    round.end();
    strip.end();
  });
  return el("figure", { className: "pad" }, el("div", { className: "group" }, round.pad, strip.pad),
    el("figcaption", {}, caption));
}

export function createPads(element, held) {
  element.append(
    pair(held, "pad move", "Move", [{ axis: 0, name: "x" }, { axis: 1, name: "y" }, { axis: 2, name: "z" }]),
    pair(held, "pad turn", "Turn", [{ axis: 4, name: "y" }, { axis: 3, name: "x" }, { axis: 5, name: "z" }]),
  );
}
