// Why the arm does what it does, what to do next, and the buttons that do it.

import { button, el, setClass, setText } from "../dom.js";

const SEVERITY = { stopping: "warning", hold: "warning", fault: "error", boot: "warning" };

/** How grave a state is, by name: as events' severities are. */
export const severityOf = ({ mode, protective_stop: stopped }) => (stopped ? "error" : (SEVERITY[mode] ?? ""));

/** How long a remark stands [ms]. */
const REMARK_MS = 6000;

export function createWhy(element, ask) {
  const sentence = el("p", {}, "Waiting for the daemon.");
  const next = el("p", {}, "");
  const box = el("div", { className: "why warning", role: "status" }, sentence, next);
  const refusal = el("span", { className: "refusal", role: "status" });
  const mode = (action) => () => ask("operator/mode", { action }, refusal);
  const acts = {
    lease: button("Take control", () => ask("operator/lease", {}, refusal), { title: "The lease: the right to command, held by one operator at a time" }),
    enable: button("Enable", mode("enable"), { title: "key m" }),
    resume: button("Resume", mode("enable"), { title: "key m" }),
    hold: button("Hold", mode("hold"), { title: "key h" }),
    disable: button("Drives off", mode("disable"), { title: "key n" }),
    reset: button("Reset", mode("reset"), { title: "key R" }),
    clear: button("Clear the stop", () => ask("operator/protective_clear", {}, refusal), { title: "key c" }),
  };
  const actions = el("div", { className: "actions", role: "group", "aria-label": "Mode" }, ...Object.values(acts), refusal);
  element.append(box, actions);

  function say(words, after, severity) {
    setText(sentence, words);
    setText(next, after);
    setClass(box, `why ${severity}`);
  }

  function offer(may, then) {
    for (const [name, act] of Object.entries(acts)) {
      act.hidden = !may.includes(name);
      act.classList.toggle("next", name === then);
    }
  }
  offer([], "");

  let remarkEnds = 0;

  return {
    say,
    offer,
    // Said for a while beside the buttons, of what the page itself did.
    remark(words) {
      setText(refusal, words);
      clearTimeout(remarkEnds);
      remarkEnds = setTimeout(() => refusal.textContent === words && setText(refusal, ""), REMARK_MS);
    },
    update({ state, why }, mine, watching) {
      say(why.sentence, why.next, severityOf(state));
      if (watching) return offer(state.protective_stop ? ["clear"] : [], "");
      const may = [];
      if (!mine) may.push("lease");
      if (state.protective_stop) may.push("clear");
      if (mine && state.mode === "ready") may.push("enable");
      if (mine && state.mode === "hold") may.push("resume", "disable");
      if (mine && state.mode === "enabled") may.push("hold", "disable");
      if (mine && state.mode === "fault") may.push("reset");
      const free = mine || state.lease_holder === null;
      const then = !free && !state.protective_stop ? "" : ["clear", "lease", "reset", "enable", "resume"].find((name) => may.includes(name));
      return offer(may, state.mode === "enabled" && mine ? "" : then);
    },
  };
}
