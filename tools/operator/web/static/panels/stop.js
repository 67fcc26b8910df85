// The protective stop: everybody's, the largest thing on the page, and the space bar's.

import { button, el } from "../dom.js";

export function createStop(element, ask) {
  const words = el("small", {}, "space bar · stops for everybody");
  const stop = button("STOP", () => press(), { id: "stop-button" });
  stop.append(words);
  // As soon as it is touched, and not when the finger leaves it.
  stop.addEventListener("pointerdown", (event) => {
    event.preventDefault();
    press();
  });
  element.append(stop);
  let asked = 0;

  async function press() {
    if (performance.now() - asked < 300) return;
    asked = performance.now();
    const reply = await ask("operator/protective_stop", {});
    if (!reply.ok) words.textContent = `not heard: ${reply.words}`;
  }

  return {
    press,
    update({ state }) {
      stop.classList.toggle("latched", state.protective_stop);
      words.textContent = state.protective_stop ? "latched: clear it to go on" : "space bar · stops for everybody";
    },
  };
}
