// The bar: cell, mode, who drives, latency and its trend, speed, who watches.

import { button, el, fixed, setClass, setText } from "../dom.js";

export function createBar(element, { link, cell, name, ask }) {
  const mode = el("span", { className: "mode", role: "status" }, "…");
  const holder = el("b", {}, "–");
  const drive = button("Take control", () => toggle(), { title: "The lease: the right to command, held by one operator at a time" });
  const refusal = el("span", { className: "refusal", role: "status" });
  const latency = el("b", {}, "–");
  const trend = el("canvas", { width: 144, height: 44, "aria-hidden": "true" });
  const viewers = el("b", { className: "pages" }, "1");
  const overruns = el("b", {}, "0");
  const insecure = el("span", { className: "mode fault", hidden: true }, "anybody may command");
  const shown = el("input", { type: "text", value: name, maxLength: 32, "aria-label": "Your name", placeholder: "your name" });
  shown.addEventListener("change", () => {
    localStorage.setItem("name", shown.value.trim());
    link.rename(shown.value.trim());
  });
  const factor = el("input", { type: "range", min: 1, max: 100, value: 100, "aria-label": "Reduced speed of all limits" });
  const factorShown = el("output", {}, "100 %");
  factor.addEventListener("input", () => setText(factorShown, `${factor.value} %`));
  factor.addEventListener("change", () => ask("operator/speed", { factor: factor.value / 100 }, refusal));

  let you = "";
  let mine = false;
  let role = "operator";
  function toggle() {
    ask(mine ? "operator/release" : "operator/lease", {}, refusal);
  }

  const minor = (node) => {
    node.classList.add("minor");
    return node;
  };
  const fact = (label, ...what) => el("span", { className: "fact" }, label, ...what);
  element.append(
    el("span", { className: "mark" }, el("img", { src: "icon.svg", alt: "" }), cell),
    mode, fact("in control", holder), drive, refusal, insecure,
    el("span", { className: "room" }),
    fact("speed", factor, factorShown), fact("latency", latency, trend),
    ...[fact("overruns", overruns), fact("pages", viewers), shown].map(minor),
  );

  const history = [];
  const paint = trend.getContext("2d");
  setInterval(() => {
    const now = link.open ? (link.echo ?? link.latency) : null;
    history.push(now);
    if (history.length > 72) history.shift();
    setText(latency, now === null ? "–" : `${fixed(now, 0)} ms`);
    latency.title = `page to console ${fixed(link.latency, 1)} ms, page's commands to the daemon and back ${fixed(link.echo, 1)} ms`;
    const most = Math.max(20, ...history.filter((value) => value !== null));
    paint.clearRect(0, 0, 144, 44);
    paint.strokeStyle = getComputedStyle(latency).color;
    paint.lineWidth = 2;
    paint.beginPath();
    history.forEach((value, i) => value !== null && paint.lineTo(2 * i, 42 - (38 * value) / most));
    paint.stroke();
  }, 500);

  link.addEventListener("link", ({ detail }) => {
    you = detail.you;
    role = detail.role;
    setText(viewers, String(detail.pages));
    shown.placeholder = you;
    drive.hidden = role !== "operator";
    insecure.hidden = detail.description?.network !== "insecure";
  });
  return {
    update({ state }, isMine) {
      mine = isMine;
      setText(mode, state.mode);
      setClass(mode, `mode ${state.mode}`);
      setText(holder, state.lease_holder === null ? "nobody" : mine ? `${state.lease_holder} (you)` : state.lease_holder);
      setText(drive, mine ? "Release control" : "Take control");
      drive.classList.toggle("next", !mine && state.lease_holder === null);
      setText(overruns, String(state.overruns));
      const percent = String(Math.round(100 * state.speed_factor));
      if (document.activeElement !== factor) {
        factor.value = percent;
        setText(factorShown, `${percent} %`);
      }
    },
    silent(words) {
      setText(mode, words);
      setClass(mode, "mode silent");
    },
  };
}
