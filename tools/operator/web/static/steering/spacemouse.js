// A SpaceMouse through WebHID: reports 1 and 2 hold translation and rotation, or 1 both.

import { button, el } from "../dom.js";

const VENDORS = [0x046d, 0x256f];
const FULL = 350;
const DEAD = 0.06;
const SILENT_MS = 150;

const part = (raw) => {
  const value = Math.max(-1, Math.min(1, raw / FULL));
  return Math.abs(value) < DEAD ? 0 : value;
};

// The puck's axes are right, towards the person, down; the stick's are forward, left, up.
export function partsOf(report, data, before) {
  const raw = (i) => part(data.getInt16(2 * i, true));
  const three = (from) => [-raw(from + 1) || 0, -raw(from) || 0, -raw(from + 2) || 0];
  if (report === 1 && data.byteLength >= 12) return [...three(0), ...three(3)];
  if (report === 1 && data.byteLength >= 6) return [...three(0), ...before.slice(3)];
  if (report === 2 && data.byteLength >= 6) return [...before.slice(0, 3), ...three(0)];
  return before;
}

export function createSpaceMouse(element, held) {
  if (!navigator.hid) {
    element.append(el("p", { className: "dim" }, "SpaceMouse: this browser has no WebHID."));
    return;
  }
  const words = el("span", { className: "dim" }, "not connected");
  let parts = [0, 0, 0, 0, 0, 0];
  let timer = 0;
  let armed = true;
  const used = new Set();
  held.onEnd(() => (armed = false));

  function end() {
    parts = [0, 0, 0, 0, 0, 0];
    held.twist("spacemouse", null);
  }

  function heard(event) {
    parts = partsOf(event.reportId, event.data, parts);
    if (parts.every((each) => each === 0)) armed = true;  // after an ending it has to be let go of first
    held.twist("spacemouse", armed && document.hasFocus() ? parts : null);
    clearTimeout(timer);
    timer = setTimeout(end, SILENT_MS);
  }

  async function use(device) {
    if (!device.opened) await device.open();
    words.textContent = device.productName;
    if (used.has(device)) return;
    used.add(device);
    device.addEventListener("inputreport", heard);
  }

  navigator.hid.addEventListener("disconnect", () => {
    words.textContent = "not connected";
    end();
  });
  element.append(el("div", { className: "row" }, button("Connect a SpaceMouse", async () => {
    const filters = VENDORS.map((vendorId) => ({ vendorId }));
    const [device] = await navigator.hid.requestDevice({ filters });
    if (device) await use(device);
  }), words));
}
