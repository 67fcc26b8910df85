/** What is drawn at one moment: poses of links and tasks, from two states and how far between. */

import { forward, rootOf } from "./kinematics.js";
import { between, composed, fromRpy } from "./poses.js";
import { mixed } from "./timeline.js";

/** Return the state of a task: that of the cell's first is the state itself. */
function told(state, description, i) {
  const own = i > 0 ? state.tasks?.[description.tasks[i].name] : null;
  return own ?? (i > 0 ? null : state);
}

const pose = (a, b, part) => {
  if (!b || b.some((x) => !Number.isFinite(x))) return null;
  const end = fromRpy(b);
  return !a || a.some((x) => !Number.isFinite(x)) ? end : between(fromRpy(a), end, part);
};

/** Return where Bases stand that do not stand where the cell has them, by their links' indices. */
function basesOf(description, sample) {
  const bases = new Map();
  description.tasks.forEach((task, i) => {
    const [a, b] = [sample.a, sample.b].map((state) => told(state, description, i)?.frames?.base);
    const T = pose(a, b, sample.part);
    if (T && task.by.length === 1) bases.set(rootOf(description, task.tip), T);
  });
  return bases;
}

/** Return the view of a sample of the timeline. */
export function viewOf(description, sample) {
  const { a, b, part } = sample;
  const bases = basesOf(description, sample);
  const q = mixed(a.q, b.q, part);
  const links = forward(description, q, bases);
  return {
    description, q, links, state: b, time: sample.time,
    commanded: forward(description, mixed(a.q_command, b.q_command, part), bases),
    carrier: pose(a.frames?.carrier, b.frames?.carrier, part),
    tasks: description.tasks.map((task, i) => {
      const [from, to] = [told(a, description, i), told(b, description, i)];
      if (!to) return { mrf: null };
      const take = (name) => pose(from?.[name], to[name], part);
      return {
        mrf: take("pose_mrf_measured"),
        crf: take("pose_crf"),
        target: take("target_mrf"),
        path: take("path_mrf"),
        wrench: to.wrench_mrf ? mixed(from?.wrench_mrf, to.wrench_mrf, part) : null,
        tunnel: to.tunnel ? { pieces: to.tunnel, open: to.tunnel_open } : null,
        held: task.by.length === 1 && Boolean(to.held_by),
        still: to.at_goal && !to.path,
      };
    }),
  };
}

/** Return the view of a cell that nothing is known of yet: the arms in their start posture. */
export function atRest(description, links) {
  return {
    description, links, commanded: links, state: null, time: 0, carrier: null,
    q: description.joints.map((joint) => joint.start),
    tasks: description.tasks.map((task) => ({
      mrf: composed(links[task.tip], task.T_wrist_mrf), held: false,
    })),
  };
}
