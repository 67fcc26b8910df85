/**
 * Where a handle that is dragged live leads the tool: towards the handle, and never far ahead.
 *
 * The daemon lets a master lead by 50 mm and 0.3 rad, and forgets the rest: a hand that is quicker
 * than the arm would lose its way. Kept nearer than that, the tool comes to where the handle is.
 */

import { between, fromRpy, toRpy } from "./poses.js";

/** The lead is at most so far from the tool [m], [rad]. */
export const LEAD = [0.04, 0.24];

/** Return the pose `[x, y, z, roll, pitch, yaw]` on the way from the tool's to the handle's. */
export function leadTo(handle, tool) {
  const [a, b] = [fromRpy(tool), fromRpy(handle)];
  const far = Math.hypot(b[0] - a[0], b[1] - a[1], b[2] - a[2]);
  const cosine = a[3] * b[3] + a[4] * b[4] + a[5] * b[5] + a[6] * b[6];
  const turn = 2 * Math.acos(Math.min(1, Math.abs(cosine)));
  if (far <= LEAD[0] && turn <= LEAD[1]) return handle;
  return toRpy(between(a, b, Math.min(LEAD[0] / far, LEAD[1] / turn)));
}
