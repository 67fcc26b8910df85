/** Forces on what arms touch, as arrows at the MRF, moments as an arc around their axis. */

import { THREE, lay } from "../stage/kit.js";
import { attitude, turned } from "../geometry/poses.js";

/** A newton is drawn so long [m], at most so long, and from so much on. */
const PER_NEWTON = 0.006;
const LONGEST = 0.45;
const LEAST_N = 1.0;
const LEAST_NM = 0.25;

export function createForces(description, materials, labels) {
  const object = new THREE.Group();
  const arrows = description.tasks.map((task) => {
    const material = materials.flat("force", 1, false);
    const shaft = new THREE.Mesh(
      new THREE.CylinderGeometry(1, 1, 1, 16).rotateX(Math.PI / 2).translate(0, 0, 0.5), material,
    );
    const head = new THREE.Mesh(
      new THREE.ConeGeometry(0.014, 0.034, 20).rotateX(Math.PI / 2).translate(0, 0, 0.017), material,
    );
    const arc = new THREE.Mesh(
      new THREE.TorusGeometry(0.05, 0.0025, 8, 40, 1.5 * Math.PI), materials.flat("force", 0.8, false),
    );
    for (const part of [shaft, head, arc]) part.renderOrder = 18;
    const arrow = new THREE.Group();
    arrow.add(shaft, head);
    object.add(arrow, arc);
    return { task, arrow, shaft, head, arc, label: labels.add("", { rank: 4, role: "force" }) };
  });
  return {
    object,
    pose(view) {
      arrows.forEach(({ task, arrow, shaft, head, arc, label }, i) => {
        const { mrf, wrench, held } = view.tasks[i];
        // Arms that hold a payload share its MRF: each one's force is drawn at its grasp.
        const at = held ? view.links[task.tip] : mrf;
        const size = wrench ? Math.hypot(...wrench.slice(0, 3)) : 0;
        const moment = wrench ? Math.hypot(...wrench.slice(3)) : 0;
        arrow.visible = Boolean(mrf) && size >= LEAST_N;
        arc.visible = Boolean(mrf) && !held && moment >= LEAST_NM;
        label.at(null);
        if (arrow.visible) {
          const force = turned(attitude(mrf), wrench.slice(0, 3));
          const length = Math.min(LONGEST, PER_NEWTON * size);
          const tip = force.map((x, k) => at[k] + (x / size) * length);
          lay(arrow, at, tip);
          const rod = Math.max(0.002, length - 0.034);
          shaft.scale.set(0.0042, 0.0042, rod);
          head.position.set(0, 0, rod);
          label.at(tip, `${size.toFixed(size < 10 ? 1 : 0)} N`);
        }
        if (arc.visible) {
          const axis = turned(attitude(mrf), wrench.slice(3));
          lay(arc, mrf, axis.map((x, k) => mrf[k] + x));
          arc.scale.setScalar(0.5 + Math.min(1.5, 0.15 * moment));
        }
      });
    },
  };
}
