// What the operator has chosen: which task is led, in which axes, and how fast.

export const SPEEDS = [0.005, 0.01, 0.02, 0.05, 0.1, 0.2];
export const FRAMES = ["crf", "mrf", "base", "world"];
/** What frames are called on the page, and what they are. */
export const FRAME_NAMES = {
  crf: ["reference (CRF)", "CRF, control reference frame: what the tool's motion is measured against"],
  mrf: ["tool (MRF)", "MRF, moving reference frame: the frame of the tool that is moved"],
  base: ["base", "Base of the arm"],
  world: ["world", "World"],
};
const TURN_PER_METRE = 4;
const BASE_PER_TOOL = 2;

export class Choices extends EventTarget {
  constructor(link) {
    super();
    this.level = 3;
    this.frame = "crf";
    this.hand = 0;
    this.description = null;
    this.state = null;
    this.posture = false;
    this._link = link;
    link.addEventListener("link", ({ detail }) => this._described(detail.description));
    link.addEventListener("state", ({ detail }) => (this.state = detail.state));
  }

  get speed() {
    return SPEEDS[this.level];
  }

  get turn() {
    return TURN_PER_METRE * this.speed;
  }

  get tasks() {
    return this.description ? [this.description, ...this.description.tasks] : [];
  }

  // The description of the arm that is led.
  get led() {
    return this.tasks[this.hand] ?? null;
  }

  // What names the task in a command, where the cell has several; the joint task while arms hold.
  get task() {
    if (this.tasks.length < 2) return {};
    return { task: this.own?.held_by ?? this.led.task };
  }

  // Of the whole cell: nothing names a task.
  get none() {
    return {};
  }

  get mechanism() {
    return this.tasks.length < 2 ? {} : { mechanism: this.led.mechanism };
  }

  // The state of the task that is led.
  get own() {
    if (!this.state || !this.led) return this.state;
    return this.state.tasks[this.led.task] ?? this.state;
  }

  get shown() {
    if (!this.state) return null;
    return this.state.tasks[this.task.task] ?? this.own;
  }

  // Fields that drive the mechanism as a whole, into its tunnels or on its wheels; null for none.
  drive(ahead, turn) {
    const { base, insertion } = this.led ?? {};
    if (!ahead && !turn) return null;
    if (insertion && ahead) return { rates: [ahead * Math.min(this.speed, insertion.speed)], ...this.mechanism };
    if (!base) return null;
    const rates = [ahead * Math.min(BASE_PER_TOOL * this.speed, base.speed),
      turn * Math.min(BASE_PER_TOOL * this.turn, base.angular_speed)];
    return { rates, ...this.mechanism };
  }

  // Where the led arm's joints begin among the cell's.
  get firstJoint() {
    return this.tasks.slice(0, this.hand).reduce((count, task) => count + task.joints.length, 0);
  }

  choose(changes) {
    Object.assign(this, changes);
    this.level = Math.max(0, Math.min(SPEEDS.length - 1, this.level));
    this.dispatchEvent(new Event("change"));
  }

  // A posture under way does not hear the stick: it is dropped first.
  aboutToMove() {
    if (!this.posture) return;
    this.posture = false;
    this._link.send("cmd/cancel", this.task);
  }

  _described(description) {
    if (JSON.stringify(description) === JSON.stringify(this.description)) return;
    this.description = description;
    if (this.hand >= this.tasks.length) this.hand = 0;
    this.dispatchEvent(new Event("change"));
    this.dispatchEvent(new Event("described"));
  }
}
