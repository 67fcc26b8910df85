// A gamepad, heard only while one of its shoulder buttons is held.

import { el } from "../dom.js";

const DEAD = 0.12;
const DEADMEN = [4, 5];
const SVG = "http://www.w3.org/2000/svg";

const axis = (value = 0) => (Math.abs(value) < DEAD ? 0 : (value - Math.sign(value) * DEAD) / (1 - DEAD));
const pressed = (pad, i) => pad.buttons[i]?.pressed === true;

// Left stick: x, y; right stick: z, and about z; cross: about x and y.
export function twistOf(pad) {
  if (!DEADMEN.some((i) => pressed(pad, i))) return null;
  const [leftX, leftY, rightX, rightY] = pad.axes.map(axis);
  return [
    -leftY || 0, -leftX || 0, -rightY || 0,
    pressed(pad, 15) - pressed(pad, 14), pressed(pad, 12) - pressed(pad, 13), -rightX || 0,
  ];
}

function shape(tag, attributes, text = "") {
  const node = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, value);
  node.textContent = text;
  return node;
}

function drawing() {
  const svg = shape("svg", { viewBox: "0 0 300 150", class: "mapping", role: "img",
    "aria-label": "Gamepad: hold a shoulder button; left stick moves along x and y, right stick along z and about z, cross about x and y" });
  const shoulders = [shape("rect", { x: 40, y: 22, width: 70, height: 14, rx: 7 }),
    shape("rect", { x: 190, y: 22, width: 70, height: 14, rx: 7 })];
  const sticks = [shape("circle", { cx: 115, cy: 100, r: 16 }), shape("circle", { cx: 185, cy: 100, r: 16 })];
  svg.append(
    shape("path", { class: "line", d: "M70 40h160c40 0 60 90 40 96-20 4-36-22-50-26H80c-14 4-30 30-50 26-20-6 0-96 40-96z" }),
    ...shoulders, ...sticks,
    shape("path", { class: "line", d: "M72 60v24M60 72h24" }),
    shape("text", { x: 75, y: 16, "text-anchor": "middle" }, "hold to move"),
    shape("text", { x: 225, y: 16, "text-anchor": "middle" }, "hold to move"),
    shape("text", { x: 115, y: 130, "text-anchor": "middle" }, "x y"),
    shape("text", { x: 185, y: 130, "text-anchor": "middle" }, "z, turn z"),
    shape("text", { x: 48, y: 56, "text-anchor": "end" }, "turn x y"),
  );
  const light = (node, on) => node.setAttribute("class", on ? "lit" : "off");
  return { svg, show(pad) {
    shoulders.forEach((node, i) => light(node, pad !== null && pressed(pad, DEADMEN[i])));
    sticks.forEach((node, i) => light(node, pad !== null &&
      (axis(pad.axes[2 * i]) !== 0 || axis(pad.axes[2 * i + 1]) !== 0)));
  } };
}

export function createGamepad(element, held) {
  const words = el("p", { className: "dim" }, "No gamepad: connect one and press a button of it.");
  const drawn = drawing();
  element.append(words, drawn.svg);
  let armed = true;
  held.onEnd(() => (armed = false));
  setInterval(() => {
    const pad = [...(navigator.getGamepads?.() ?? [])].find((found) => found?.connected) ?? null;
    const twist = pad && twistOf(pad);
    if (!twist) armed = true;  // after an ending the button has to be let go of first
    held.twist("gamepad", armed && document.hasFocus() ? twist : null);
    drawn.show(pad);
    if (pad && words.dataset.id !== pad.id) {
      words.dataset.id = pad.id;
      words.textContent = pad.id;
    }
  }, 10);
}
