// How arms share the load of the payload that they hold together: what each carries, and its weight in W.

import { button, el, fixed, setText } from "../dom.js";

/** Words for what an arm carries of what it is to carry, [share, carried] in N. */
export function carriedWords([share, carried]) {
  return `carries ${carried === null ? "?" : fixed(carried, 1)} of ${fixed(share, 1)} N`;
}

export function createShares(element, { ask, choices }) {
  const refusal = el("span", { className: "refusal", role: "status" });
  const list = el("div", {});
  let rows = [];
  let listed = "";

  const send = (weights) => ask("operator/load_shares", { weights, ...choices.task }, refusal);
  const set = () => send(rows.map(({ weight }) => Array(6).fill(Number(weight.value.replace(",", ".")))));
  element.append(list, el("div", { className: "row" },
    button("Share the load so", set, { title: "weights of W: the dearer an arm, the less it carries" }),
    button("As the cell says", () => send([]))), refusal);

  return {
    update() {
      const { shares, carried } = choices.shown ?? {};
      const names = Object.keys(shares ?? {});
      element.parentElement.hidden = names.length === 0;
      if (names.join() !== listed) {
        listed = names.join();
        rows = names.map((name) => ({
          name,
          weight: el("input", { type: "text", inputMode: "decimal", size: 6, "aria-label": `${name} weight`, value: fixed(shares[name][0], 3) }),
          told: el("output", { className: "mono grow" }),
        }));
        list.replaceChildren(...rows.map(({ name, weight, told }) =>
          el("div", { className: "row" }, el("span", {}, name), told, weight)));
      }
      for (const { name, told } of rows) setText(told, carriedWords(carried[name]));
    },
  };
}
