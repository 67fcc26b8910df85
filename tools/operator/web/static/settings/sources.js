// Each source's switch and gains, as they are in effect.

import { button, el } from "../dom.js";
import { NAMES } from "../panels/now.js";
import { AXES } from "./axes.js";

/** Return the units of a gain's first three and last three axes. */
const unitsOf = (unit) => {
  const [linear, angular = linear] = unit.split(", ");
  return AXES.map((_, i) => (i < 3 ? linear : angular));
};

export function createSources(element, { ask, choices, units }) {
  let cards = [];

  function card(source, gains) {
    const refusal = el("span", { className: "refusal", role: "status" });
    const on = el("input", { type: "checkbox", id: `on-${source}` });
    on.addEventListener("change", async () => {
      const reply = await ask("operator/switch", { source, on: on.checked, ...choices.task }, refusal);
      if (!reply.ok) on.checked = !on.checked;
    });
    const fields = gains.map((_, i) => el("input", { type: "text", inputMode: "decimal", "aria-label": `${source} gain ${AXES[i]}` }));
    const forced = el("input", { type: "checkbox", id: `forced-${source}` });
    const set = () => ask("operator/gain", { source, forced: forced.checked, ...choices.task,
      gain: fields.map((field) => Number(field.value.replace(",", "."))) }, refusal);
    const node = el("div", { className: "card" },
      el("div", { className: "row" }, on, el("label", { htmlFor: on.id, className: "grow" }, el("b", {}, NAMES[source] ?? source.replaceAll("_", " "))),
        button("Set gains", set), forced, el("label", { htmlFor: forced.id, className: "dim", title: "even beyond the bound of stability" }, "force it")),
      el("div", { className: "gains" },
        ...AXES.map((axis) => el("b", { className: "mono", "aria-hidden": "true" }, axis)), ...fields,
        ...unitsOf(units[source] ?? "1").map((unit) => el("small", { title: unit }, unit === "1" ? "" : unit))), refusal);
    return { source, node, on, fields };
  }

  choices.addEventListener("change", () => {
    const gains = choices.led?.gains ?? {};
    const now = Object.keys(gains).join();
    if (now === element.dataset.sources) return;
    element.dataset.sources = now;
    cards = Object.entries(gains).map(([source, values]) => card(source, values));
    element.replaceChildren(...cards.map(({ node }) => node));
  });

  return {
    update() {
      const own = choices.shown;
      if (!own || element.offsetParent === null) return;
      for (const { source, node, on, fields } of cards) {
        if (node.contains(document.activeElement)) continue;
        on.checked = own.on[source] ?? false;
        (own.gains[source] ?? []).forEach((gain, i) => {
          const text = String(Number(gain.toPrecision(3)));
          if (fields[i].value !== text) fields[i].value = text;
        });
      }
    },
  };
}
