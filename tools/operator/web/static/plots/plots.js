/** Plots against time: force, joints, gaps, twist by source and period, with one cursor for all. */

import { createChart } from "./chart.js";
import { WINDOW_S, chartsOf, createSeries } from "./series.js";

/** Plots are drawn this often [ms]: the eye reads no faster, and the scene needs the time. */
const EVERY_MS = 125;

export function createPlots(element, description) {
  const kinds = chartsOf(description);
  const series = createSeries(kinds);
  const events = [];
  let changed = false;
  const strip = document.createElement("div");
  strip.className = "plots-strip";
  Object.assign(strip.style, { display: "flex", height: "100%", overflowX: "auto", overflowY: "hidden" });
  strip.tabIndex = 0;
  strip.setAttribute("role", "group");
  strip.setAttribute("aria-label", "Charts against time");
  const fold = document.createElement("button");
  Object.assign(fold, { type: "button", className: "fold", textContent: "Plots" });
  fold.setAttribute("aria-expanded", "false");
  fold.addEventListener("click", () => {
    const open = fold.getAttribute("aria-expanded") !== "true";
    fold.setAttribute("aria-expanded", String(open));
    changed = true;
  });
  element.append(fold, strip);
  const charts = kinds.map((chart) => createChart(strip, chart, { events, times: series.times }));

  const timer = setInterval(() => {
    if (!changed || document.hidden || !strip.clientHeight) return;
    changed = false;
    const until = series.times.at(-1);
    while (events.length && events[0].time < until - WINDOW_S) events.shift();
    charts.forEach((chart, i) => chart.draw(series.data(i), until - WINDOW_S));
  }, EVERY_MS);

  return {
    /** Take in a message: `state`, or `event`, which is marked where it is no mere information. */
    update(message) {
      if (message.type === "state") {
        changed = series.add(message.state) || changed;
      } else if (message.type === "event" && message.severity !== "info") {
        events.push({ time: message.time_s, severity: message.severity });
      }
    },
    dispose() {
      clearInterval(timer);
      charts.forEach((chart) => chart.dispose());
      strip.remove();
      fold.remove();
    },
  };
}
