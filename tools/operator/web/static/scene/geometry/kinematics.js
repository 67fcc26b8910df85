/** Where links are at given joint angles: forward kinematics of a described cell; no library. */

import { composed } from "./poses.js";

/** Return how many joints a description has. */
export const countJoints = (description) => description.joints.length;

/**
 * Return the pose in World of every link.
 *
 * `q` are joint angles in State's order; a missing one (NaN or null) stands at zero. `bases` maps
 * the index of a Base's link to its pose in World, where it is not where the cell has it.
 */
export function forward(description, q, bases = new Map()) {
  const poses = [];
  description.links.forEach((link, i) => {
    const place = link.parent < 0
      ? bases.get(i) ?? link.pose
      : composed(poses[link.parent], link.pose);
    const way = link.joint < 0 ? 0 : q[link.joint];
    poses.push(Number.isFinite(way) && way !== 0 ? composed(place, moved(link, way)) : place);
  });
  return poses;
}

/** Return how far a joint moves its link. */
function moved(link, way) {
  const [x, y, z] = link.axis;
  if (link.kind === "prismatic") return [x * way, y * way, z * way, 0, 0, 0, 1];
  const s = Math.sin(way / 2);
  return [0, 0, 0, x * s, y * s, z * s, Math.cos(way / 2)];
}

/** Return the index of the Base's link that carries a link. */
export function rootOf(description, link) {
  let i = link;
  while (description.links[i].parent >= 0) i = description.links[i].parent;
  return i;
}

/** Return the segments of a link's capsules in World: `{of, start, end, radius}`. */
export function capsulesAt(description, poses, place) {
  return description.links.flatMap((link, i) => link.capsules.map((capsule) => ({
    of: capsule.of,
    start: place(poses[i], capsule.start),
    end: place(poses[i], capsule.end),
    radius: capsule.radius,
  })));
}
