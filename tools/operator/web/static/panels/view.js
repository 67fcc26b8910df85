// Where the scene is looked at from, and what is drawn in it.

import { button, el } from "../dom.js";

const SHOWN = [["ghost", "ghost"], ["labels", "names"], ["gaps", "gaps"], ["forces", "forces"], ["trail", "path"]];

export function createView(element, scene, views) {
  const looks = views.map((view) => button(view, () => scene.setOptions({ view })));
  const shown = SHOWN.map(([option, text]) => {
    const toggle = button(text, () => {
      const on = toggle.getAttribute("aria-pressed") !== "true";
      toggle.setAttribute("aria-pressed", String(on));
      scene.setOptions({ [option]: on });
    }, { "aria-pressed": "true" });
    return toggle;
  });
  element.append(el("div", { role: "group", "aria-label": "Views" }, ...looks),
    el("div", { role: "group", "aria-label": "Drawn in the scene" }, ...shown));
}
