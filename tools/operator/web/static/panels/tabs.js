// Tabs, by pointer and by arrow keys.

import { el } from "../dom.js";

export function createTabs(element, names) {
  const list = element.appendChild(el("div", { className: "tabs", role: "tablist", "aria-label": "Panels" }));
  const panels = {};
  const tabs = names.map((name) => {
    const id = name.toLowerCase();
    const tab = el("button", { type: "button", role: "tab", id: `tab-${id}`, "aria-controls": `panel-${id}`, onclick: () => show(name) }, name);
    panels[name] = el("div", { className: "tab", role: "tabpanel", id: `panel-${id}`, "aria-labelledby": `tab-${id}`, tabIndex: 0 });
    list.append(tab);
    element.append(panels[name]);
    return tab;
  });

  function show(chosen) {
    names.forEach((name, i) => {
      tabs[i].setAttribute("aria-selected", String(name === chosen));
      tabs[i].tabIndex = name === chosen ? 0 : -1;
      panels[name].hidden = name !== chosen;
    });
  }

  list.addEventListener("keydown", (event) => {
    const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
    if (!step) return;
    const at = (tabs.indexOf(document.activeElement) + step + names.length) % names.length;
    tabs[at].focus();
    show(names[at]);
  });
  show(names[0]);
  return panels;
}
