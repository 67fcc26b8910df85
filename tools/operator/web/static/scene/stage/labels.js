/** Labels over the scene: text at places in World, as HTML, so that it is sharp and can be read out. */

import { THREE } from "./kit.js";

export function createLabels(element, stage) {
  const layer = document.createElement("div");
  layer.className = "scene-labels";
  Object.assign(layer.style, {
    position: "absolute", inset: "0", pointerEvents: "none", overflow: "hidden",
    font: "500 11px/1.25 ui-sans-serif, system-ui, sans-serif", letterSpacing: "0.01em",
  });
  element.append(layer);
  const labels = new Set();
  const spot = new THREE.Vector3();
  let theme = null;
  let shown = true;

  function paint(label) {
    const { span, role } = label;
    if (!theme) return;
    span.style.background = theme.plate;
    span.style.color = role && theme[role] !== undefined
      ? `#${new THREE.Color(theme[role]).getHexString()}` : theme.ink;
  }

  return {
    layer,
    /** Add a label; of two that meet, the one of higher rank keeps its place. */
    add(text, { rank = 0, role = null } = {}) {
      const span = document.createElement("span");
      span.textContent = text;
      Object.assign(span.style, {
        position: "absolute", left: "0", top: "0", padding: "1px 6px", borderRadius: "5px",
        whiteSpace: "nowrap", willChange: "transform", visibility: "hidden",
      });
      layer.append(span);
      const label = { span, text, rank, role, place: null, width: 0 };
      labels.add(label);
      paint(label);
      return {
        at(place, words = label.text) {
          label.place = place && [place[0] ?? place.x, place[1] ?? place.y, place[2] ?? place.z];
          if (words !== label.text) {
            label.text = words;
            span.textContent = words;
            label.width = 0;
          }
        },
        setRole(next) {
          if (next !== label.role) {
            label.role = next;
            paint(label);
          }
        },
        remove() {
          span.remove();
          labels.delete(label);
        },
      };
    },
    setTheme(next) {
      theme = next;
      labels.forEach(paint);
    },
    show(on) {
      shown = on;
      layer.style.display = on ? "" : "none";
    },
    /** Put all labels beside their places as the camera sees them. */
    draw() {
      if (!shown) return;
      const [width, height] = stage.size();
      const taken = [];
      for (const label of [...labels].sort((a, b) => b.rank - a.rank)) {
        if (!label.place) {
          label.span.style.visibility = "hidden";
          continue;
        }
        spot.set(...label.place).project(stage.camera);
        if (spot.z > 1 || Math.abs(spot.x) > 1 || Math.abs(spot.y) > 1) {
          label.span.style.visibility = "hidden";
          continue;
        }
        label.width ||= label.span.offsetWidth;
        const x = Math.min(0.5 * (spot.x + 1) * width + 9, width - label.width - 4);
        let y = Math.max(4, 0.5 * (1 - spot.y) * height - 20);
        const most = label.rank > 1 ? 8 : 2;
        let steps = 0;
        for (; steps <= most; steps += 1) {
          const met = taken.find((t) => x < t.x + t.width && t.x < x + label.width
            && Math.abs(y - t.y) < 17);
          if (!met) break;
          y = met.y + 17.5;
        }
        if (steps > most) {
          label.span.style.visibility = "hidden";
          continue;
        }
        taken.push({ x, y, width: label.width });
        label.span.style.visibility = "visible";
        label.span.style.transform = `translate(${x.toFixed(1)}px, ${y.toFixed(1)}px)`;
      }
    },
    dispose() { layer.remove(); },
  };
}
