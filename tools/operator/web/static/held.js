// Everything that is held, by what holds it. All of it ends at once when the page can no longer be
// trusted to hear a release: blur, a hidden tab, a lost link, a lapse, a mode in which nothing moves.

const ENDINGS = [
  [window, "blur"], [window, "pagehide"], [document, "freeze"], [window, "beforeunload"],
];

export class Held {
  constructor(link, choices) {
    this._link = link;
    this._choices = choices;
    this._twists = new Map();
    this._streams = new Map();
    this._endings = new Set();
    for (const [target, name] of ENDINGS) target.addEventListener(name, () => this.endAll());
    document.addEventListener("visibilitychange", () => document.hidden && this.endAll());
    link.addEventListener("open", () => this.endAll());
    link.addEventListener("lapsed", () => this.endAll());
    choices.addEventListener("change", () => this._tell());
  }

  // Called when everything ends, so that keys, pads and sliders forget what they held.
  onEnd(callback) {
    this._endings.add(callback);
  }

  // A part of the stick's twist, each axis from -1 to 1; null lets go.
  twist(holder, parts) {
    const before = this._twists.get(holder);
    if (parts && parts.some((part) => part !== 0)) this._twists.set(holder, parts);
    else if (!this._twists.delete(holder)) return;
    if (!before && parts) this._choices.aboutToMove();
    this._tell();
  }

  // Another stream that is held, with all its fields; null lets go.
  stream(topic, fields) {
    if (fields) this._streams.set(topic, fields);
    else if (!this._streams.delete(topic)) return;
    this._tell();
  }

  endAll() {
    this._twists.clear();
    this._streams.clear();
    for (const callback of this._endings) callback();
    this._tell();
  }

  get any() {
    return this._twists.size + this._streams.size > 0;
  }

  _tell() {
    const held = Object.fromEntries(this._streams);
    if (this._twists.size) {
      const sum = [0, 0, 0, 0, 0, 0];
      for (const parts of this._twists.values()) parts.forEach((part, i) => (sum[i] += part));
      const { speed, turn, frame, task } = this._choices;
      const twist = sum.map((part, i) => Math.max(-1, Math.min(1, part)) * (i < 3 ? speed : turn));
      held["cmd/joystick"] = { twist, expressed_in: frame, ...task };
    }
    this._link.hold(held);
  }
}
