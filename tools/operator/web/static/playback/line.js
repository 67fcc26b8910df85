// The time line: play and pause, a slider with a mark at each event of note, speed, the time.

import { button, el, setText } from "../dom.js";

const SPEEDS = [0.1, 0.25, 0.5, 1, 2, 5, 10];
const STEP_S = 1;

export function createLine(element, player, events) {
  const play = button("Play", () => (player.playing ? player.pause() : player.play()), { id: "play" });
  const slider = el("input", { type: "range", min: 0, max: player.length, step: 0.01, value: 0, "aria-label": "Time in the run, in seconds" });
  slider.addEventListener("input", () => player.seek(Number(slider.value)));
  const speed = el("select", { "aria-label": "Speed" }, ...SPEEDS.map((each) => el("option", { value: each, selected: each === 1 }, `× ${each}`)));
  speed.addEventListener("change", () => player.setSpeed(Number(speed.value)));
  const marks = el("div", { className: "marks", "aria-hidden": "true" });
  for (const event of events) {
    if (event.severity === "info" || player.length <= 0) continue;
    const mark = marks.appendChild(el("i", { className: event.severity }));
    mark.style.left = `${(100 * event.t) / player.length}%`;
  }
  const told = el("output", { className: "mono", "aria-label": "Time" });
  element.append(play, el("div", { className: "way" }, slider, marks), told, speed);

  document.addEventListener("keydown", (event) => {
    if (event.target instanceof HTMLElement && event.target.matches("input, select, button")) return;
    if (event.key === " ") play.click();
    else if (event.key === "ArrowRight") player.seek(player.time + STEP_S);
    else if (event.key === "ArrowLeft") player.seek(player.time - STEP_S);
    else return;
    event.preventDefault();
  });

  return {
    update() {
      setText(play, player.playing ? "Pause" : "Play");
      slider.value = player.time;
      setText(told, `${player.time.toFixed(2)} / ${player.length.toFixed(2)} s`);
    },
  };
}
