/** The contour ahead: a plate in each cell in which a scanner has seen something. */

import { THREE, place } from "../stage/kit.js";
import { rootOf } from "../geometry/kinematics.js";
import { composed } from "../geometry/poses.js";

const THICK = 0.006;
/** A plate fills so much of its cell. */
const FILLED = 0.86;

/** Return where plates stand, seen from the arm's foot [m]: cells are side by side, right to left, from the foot up. */
export function platesOf({ rows, columns, cell, nearest_mm: nearest }) {
  return nearest.flatMap((ahead, k) => (ahead === null ? [] : [[
    ahead / 1000, ((k % columns) + 0.5 - 0.5 * columns) * cell, (Math.floor(k / columns) + 0.5) * cell,
  ]])).slice(0, rows * columns);
}

export function createContour(description, materials) {
  const object = new THREE.Group();
  const root = rootOf(description, description.tasks[0].tip);
  const foot = [...(description.foot ?? [0, 0, 0]), 0, 0, 0, 1];
  const shape = new THREE.BoxGeometry(1, 1, 1);
  const matrix = new THREE.Matrix4();
  let plates = null;
  let links = null;

  function grown(count) {
    if (plates && plates.instanceMatrix.count >= count) return plates;
    plates?.removeFromParent();
    plates?.dispose();
    plates = new THREE.InstancedMesh(shape, materials.flat("warning", 0.55), count);
    plates.frustumCulled = false;
    object.add(plates);
    return plates;
  }

  return {
    object,
    /** Take in a contour: it stays in World where the foot is now, until the next one. */
    news(contour) {
      if (!links) return;
      place(object, composed(links[root], foot));
      const places = platesOf(contour);
      const mesh = grown(Math.max(1, contour.rows * contour.columns));
      const side = FILLED * contour.cell;
      places.forEach(([x, y, z], i) => {
        mesh.setMatrixAt(i, matrix.makeScale(THICK, side, side).setPosition(x, y, z));
      });
      mesh.count = places.length;
      mesh.instanceMatrix.needsUpdate = true;
    },
    pose(view) { links = view.links; },
  };
}
