// What acts now: each source's share of the twist, the limits in words, force, what is near.

import { el, fixed, setText } from "../dom.js";

const KNOWN = ["joystick", "master", "position", "force", "vision", "following", "spring", "reflex", "frames"];
const AXES = ["x", "y", "z", "rx", "ry", "rz"];
export const NAMES = { joystick: "stick", frames: "moving frames" };

const kind = (source) => (KNOWN.includes(source) ? source : "other");

export function createNow(element, choices) {
  const legend = el("div", { className: "legend" });
  const rows = AXES.map((axis, i) => {
    const bars = el("div", { className: "bars", role: "img", "aria-label": `Shares of the twist, ${axis}` });
    const sum = el("output", { className: "mono" });
    return { axis: i, bars, sum, row: el("div", { className: "share" }, el("b", { className: "mono" }, axis), bars, sum), parts: new Map() };
  });
  const limits = el("ul", { className: "plain limits" });
  const force = el("p", { className: "mono" });
  const near = el("p", { className: "mono" });
  const seen = el("div", { hidden: true }, el("h2", {}, "Off the stored view"));
  const view = seen.appendChild(el("p", { className: "mono" }));
  const place = el("p", { className: "mono" });
  const wheels = el("div", { hidden: true }, el("h2", {}, "Base in World"));
  const stands = wheels.appendChild(el("p", { className: "mono" }));
  const way = el("div", { hidden: true }, el("h2", {}, "Ahead"));
  const passage = way.appendChild(el("p", {}));
  element.append(
    el("h2", {}, "Who moves the tool"), legend, ...rows.map(({ row }) => row),
    el("h2", {}, "Limits that act"), limits, way,
    el("h2", {}, "Force on the tool"), force, seen,
    el("h2", {}, "Nearest"), near, el("h2", {}, "Tool in World"), place, wheels,
  );
  let listed = "";
  let limited = null;

  function list(sources, on) {
    const now = JSON.stringify([sources, on]);
    if (now === listed) return;
    listed = now;
    legend.replaceChildren(...sources.map((source) => el("span",
      { className: `${kind(source)}${on[source] === false ? " off" : ""}` }, NAMES[source] ?? source.replaceAll("_", " "))));
  }

  // Bars are stacked from the middle, towards where each source leads; full is twice the stick.
  function stack({ axis, bars, sum, parts }, sources, total) {
    const full = 2 * (axis < 3 ? choices.speed : choices.turn);
    const ends = [50, 50];
    for (const [source, twist] of Object.entries(sources)) {
      let bar = parts.get(source);
      if (!bar) parts.set(source, (bar = bars.appendChild(el("i", { className: kind(source), title: source }))));
      const share = Math.min(50, (50 * Math.abs(twist[axis] ?? 0)) / full);
      const side = twist[axis] > 0 ? 1 : 0;
      bar.style.width = `${share}%`;
      bar.style.left = `${side ? ends[1] : ends[0] - share}%`;
      ends[side] += side ? share : -share;
    }
    setText(sum, axis < 3 ? `${fixed(1000 * total[axis], 1)} mm/s` : `${degrees(total[axis])}/s`);
  }

  const degrees = (angle) => `${fixed((angle * 180) / Math.PI, 1)}°`;

  return {
    // What a scanner says of the way ahead, and how near the nearest of it is.
    ahead({ words, nearest_mm: nearest, most_speed: most }) {
      way.hidden = false;
      const seen = nearest.filter((each) => each !== null);
      const far = seen.length ? ` Nearest ${fixed(Math.min(...seen) / 1000, 2)} m.` : "";
      const slowed = most === null ? "" : ` The base drives at most ${fixed(1000 * most, 0)} mm/s.`;
      setText(passage, `${words}${far}${slowed}`);
    },
    update({ state, limits: words }) {
      if (element.offsetParent === null) return;
      const own = choices.shown ?? state;
      list(Object.keys(own.sources), own.on);
      for (const row of rows) stack(row, own.sources, own.twist);
      const said = own.limits.map((name) => words[name] ?? name);
      if (JSON.stringify(said) !== limited) {
        limited = JSON.stringify(said);
        limits.replaceChildren(...(said.length ? said.map((text) => el("li", {}, text)) : [el("li", { className: "none" }, "none")]));
      }
      const wrench = own.wrench_mrf;
      setText(force, wrench ? `${wrench.slice(0, 3).map((f) => fixed(f, 1)).join("  ")} N   ${wrench.slice(3).map((m) => fixed(m, 2)).join("  ")} N·m` : "no sensor");
      const [off, pixels] = [own.view_error, own.view_error_px];
      seen.hidden = !off && !Number.isFinite(pixels);
      setText(view, [
        off ? `${fixed(1000 * off[0], 1)} mm   ${degrees(off[1])}` : "", Number.isFinite(pixels) ? `${fixed(pixels, 1)} px` : "",
        own.view_law ? `kept by its ${own.view_law === "image" ? "picture" : "pose"}` : "",
      ].filter(Boolean).join("   "));
      const [gap] = [...state.gaps].sort((a, b) => a[2] - b[2]);
      setText(near, gap ? `${gap[0]} – ${gap[1]}: ${fixed(1000 * gap[2], 0)} mm` : "nothing known");
      const [x, y, z, ...attitude] = own.pose_mrf;
      setText(place, `${[x, y, z].map((m) => fixed(m, 3)).join("  ")} m   ${attitude.map(degrees).join("  ")}`);
      const base = choices.led?.base && own.frames?.base;
      wheels.hidden = !base;
      if (base) setText(stands, `${base.slice(0, 2).map((m) => fixed(m, 3)).join("  ")} m   heading ${degrees(base[5])}`);
    },
  };
}
