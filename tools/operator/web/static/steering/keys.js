// Keys, with their real release; the same letters as in the terminal, by their place on the keyboard.

export const AXES = {
  KeyW: [0, 1], KeyS: [0, -1], KeyA: [1, 1], KeyD: [1, -1], KeyR: [2, 1], KeyF: [2, -1],
  KeyU: [3, 1], KeyO: [3, -1], KeyI: [4, 1], KeyK: [4, -1], KeyJ: [5, 1], KeyL: [5, -1],
};
const DRIVES = { KeyV: [1, 0], KeyB: [-1, 0], Comma: [0, 1], Period: [0, -1] };

// A text field keeps its letters; sliders and buttons do not.
function typing(target) {
  if (target.closest("select")) return true;
  const field = target.closest("input, textarea");
  return field !== null && !["range", "checkbox", "button"].includes(field.type);
}

export function steerByKeys(held, choices, acts) {
  const down = new Set();

  function tell() {
    const parts = [0, 0, 0, 0, 0, 0];
    for (const code of down) if (AXES[code]) parts[AXES[code][0]] += AXES[code][1];
    held.twist("keys", parts);
    const drive = [0, 0];
    for (const code of down) (DRIVES[code] ?? []).forEach((part, i) => (drive[i] += part));
    held.stream("cmd/drive", choices.drive(...drive));
  }

  // Captured first: whatever has the focus, the space bar stops.
  addEventListener("keydown", (event) => {
    if (event.code === "Space" && !typing(event.target)) {
      event.preventDefault();
      event.stopPropagation();
      if (!event.repeat) acts.stop();
    }
  }, { capture: true });
  // Whatever has the focus, Escape lets go of all that is held.
  addEventListener("keydown", (event) => event.key === "Escape" && held.endAll(), { capture: true });
  addEventListener("keyup", (event) => {
    if (event.code === "Space" && !typing(event.target)) event.preventDefault();
    if (down.delete(event.code)) tell();
  }, { capture: true });
  addEventListener("keydown", (event) => {
    if (event.repeat || event.ctrlKey || event.metaKey || event.altKey || typing(event.target)) return;
    if (AXES[event.code] || DRIVES[event.code]) {
      down.add(event.code);
      tell();
    } else if (acts[event.key]) {
      acts[event.key]();
    }
  });
  held.onEnd(() => down.clear());
}
