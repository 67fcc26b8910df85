// Virtual links, along which the tool may leave its path: how they point, and how far it is off on each.

import { button, el, fixed, setText } from "../dom.js";

const AXES = { world: "of World", mrf: "of the tool", crf: "of the reference", path: "of the path" };
const number = (text) => Number(text.replace(",", "."));

/** Words for how far the tool is off its path, along each link [m]. */
export function offWords(offs) {
  return offs.length ? `off the path by ${offs.map((off) => `${fixed(1e3 * off, 1)} mm`).join(" and ")}` : "on its path";
}

export function createLinks(element, { ask, choices }) {
  const refusal = el("span", { className: "refusal", role: "status" });
  const told = el("output", { className: "mono" });
  const field = (name, size) => el("input", { type: "text", size, "aria-label": name });
  const directions = [field("first link", 9), field("second link", 9)];
  const axes = el("select", { "aria-label": "axes of the links" },
    ...Object.entries(AXES).map(([value, text]) => el("option", { value }, text)));
  const always = el("input", { type: "checkbox", id: "links-always" });
  const stiffness = field("stiffness of the links", 6);
  let listed = "";

  const send = (fields) => ask("operator/virtual_links", { ...fields, ...choices.task }, refusal);
  const set = () => send({
    directions: directions.map(({ value }) => value.trim()).filter(Boolean).map((value) => value.split(/[\s;]+/).map(number)),
    axes: axes.value, always: always.checked, stiffness: number(stiffness.value),
  });
  element.append(told,
    el("div", { className: "row", title: "a direction is three numbers, as 0 0 1; the second is square to the first, or left empty" },
      ...directions, axes),
    el("div", { className: "row" }, always, el("label", { htmlFor: always.id }, "off a path too"), stiffness, el("span", {}, "N/m")),
    el("div", { className: "row" }, button("Set the links", set), button("As the cell says", () => send({ reset: true }))), refusal);

  return {
    update() {
      const { links, link_directions: ways, link_offs: offs } = choices.shown ?? {};
      element.parentElement.hidden = !links;
      if (!links) return;
      setText(told, offWords(offs));
      const now = JSON.stringify([links, ways]);
      if (now === listed || element.querySelector("input:focus, select:focus")) return;
      listed = now;
      directions.forEach((each, i) => { each.value = (ways[i] ?? []).map((x) => String(Number(x.toPrecision(3)))).join(" "); });
      axes.value = links.axes;
      always.checked = links.always;
      stiffness.value = String(links.stiffness);
    },
  };
}
