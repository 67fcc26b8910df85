/** The centre line of a tunnel that an operator told: frames along pieces that turn evenly. */

import { attitude, fromRpy, turned } from "./poses.js";

/** Return the end frame of a short way along x, turned by a vector: `way` (3), and rows of R. */
function onward(length, [x, y, z]) {
  const square = x * x + y * y + z * z;
  const angle = Math.sqrt(square);
  const s = angle > 1e-9 ? Math.sin(angle) / angle : 1;
  const c = angle > 1e-9 ? (1 - Math.cos(angle)) / square : 0.5;
  const d = angle > 1e-9 ? (1 - s) / square : 1 / 6;
  return {
    way: [1 - d * (y * y + z * z), d * x * y + c * z, d * x * z - c * y].map((k) => length * k),
    R: [
      [1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y],
      [c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x],
      [c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y)],
    ],
  };
}

const cross = (a, b) => [0, 1, 2].map((i) => (
  a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3]));

/**
 * Return frames [origin, y, z] in World, at most `step` apart: a row for each passage.
 *
 * The first begins at an entrance of that form. `pieces` are [length, bend, climb, roll], or a gap's
 * length and the pose of the next passage's entrance; the last `open` have no walls, and no frames.
 */
export function centreLine(entrance, pieces, open, step) {
  let [p, y, z] = [entrance.slice(0, 3), entrance.slice(3, 6), entrance.slice(6, 9)];
  const rows = [[[...p, ...y, ...z]]];
  for (const [length, ...turn] of pieces.slice(0, pieces.length - open)) {
    if (turn.length === 6) {
      const q = attitude(fromRpy(turn));
      [p, y, z] = [turn.slice(0, 3), turned(q, [0, 1, 0]), turned(q, [0, 0, 1])];
      rows.push([[...p, ...y, ...z]]);
      continue;
    }
    const [bend, climb, roll] = turn;
    const count = Math.ceil(length / step);
    const { way, R } = onward(length / count, [roll, -climb, bend].map((angle) => angle / count));
    for (let k = 0; k < count; k += 1) {
      const axes = [cross(y, z), y, z];
      const onwards = (column) => [0, 1, 2].map((i) => (
        axes[0][i] * R[0][column] + axes[1][i] * R[1][column] + axes[2][i] * R[2][column]));
      p = p.map((at, i) => at + axes[0][i] * way[0] + axes[1][i] * way[1] + axes[2][i] * way[2]);
      [y, z] = [onwards(1), onwards(2)];
      rows.at(-1).push([...p, ...y, ...z]);
    }
  }
  return rows;
}
