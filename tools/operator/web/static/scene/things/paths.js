/** Where the tool was and is led to: its trail, the path's reference, and the target. */

import { THREE, place } from "../stage/kit.js";
import { triad } from "./frames.js";

const POINTS = 500;
/** A bead of the trail is at least so far from the one before [m], and lasts so long [s]. */
const STEP = 0.006;
const LASTS_S = 12;

export function createPaths(description, materials, labels, scale) {
  const object = new THREE.Group();
  const each = description.tasks.map((task) => {
    const trail = createTrail();
    const target = triad(0.085 * scale, materials, 0.95);
    const halo = new THREE.Mesh(
      new THREE.SphereGeometry(0.012 * scale, 20, 14), materials.flat("target", 0.85),
    );
    target.add(halo);
    const way = new THREE.Line(
      new THREE.BufferGeometry().setFromPoints([new THREE.Vector3(), new THREE.Vector3()]),
      new THREE.LineDashedMaterial({ dashSize: 0.018, gapSize: 0.012, toneMapped: false }),
    );
    way.frustumCulled = false;
    const led = new THREE.Mesh(new THREE.SphereGeometry(0.009 * scale, 16, 12), materials.flat("target"));
    object.add(trail.line, target, way, led);
    const words = description.tasks.length > 1 ? `target ${task.name}` : "target";
    return { trail, target, way, led, label: labels.add(words, { rank: 3, role: "target" }) };
  });
  return {
    object,
    setTheme(theme) {
      for (const { trail, way } of each) {
        trail.colour.set(theme.trail);
        way.material.color.set(theme.target);
      }
    },
    clear() { for (const { trail } of each) trail.clear(); },
    pose(view) {
      each.forEach(({ trail, target, way, led, label }, i) => {
        const { mrf, target: goal, path, held, still } = view.tasks[i];
        if (mrf && !held) trail.add(mrf, view.time);
        trail.fade(view.time);
        const shown = Boolean(goal) && !held && !still;
        target.visible = way.visible = shown;
        led.visible = Boolean(path) && shown;
        label.at(shown ? goal : null);
        if (!shown) return;
        place(target, goal);
        if (path) place(led, path);
        const ends = way.geometry.attributes.position;
        ends.setXYZ(0, mrf[0], mrf[1], mrf[2]);
        ends.setXYZ(1, goal[0], goal[1], goal[2]);
        ends.needsUpdate = true;
        way.computeLineDistances();
      });
    },
  };
}

/** Beads at the last places, that shrink with their age. */
function createTrail() {
  const material = new THREE.MeshBasicMaterial({
    transparent: true, opacity: 0.8, depthWrite: false, toneMapped: false,
  });
  const line = new THREE.InstancedMesh(new THREE.SphereGeometry(0.0032, 8, 6), material, POINTS);
  line.frustumCulled = false;
  line.count = 0;
  const matrix = new THREE.Matrix4();
  let points = [];
  return {
    line,
    colour: material.color,
    clear() { points = []; },
    add(T, time) {
      const last = points.at(-1);
      if (last && time < last.time) points = [];
      if (last && Math.hypot(...[0, 1, 2].map((i) => T[i] - last.T[i])) < STEP) return;
      points.push({ T: [T[0], T[1], T[2]], time });
      if (points.length > POINTS) points.shift();
    },
    fade(time) {
      if (points[0] && time - points[0].time > LASTS_S) points.shift();
      points.forEach(({ T, time: then }, i) => {
        const size = Math.sqrt(Math.max(0, 1 - (time - then) / LASTS_S));
        line.setMatrixAt(i, matrix.makeScale(size, size, size).setPosition(...T));
      });
      line.count = points.length;
      line.instanceMatrix.needsUpdate = true;
    },
  };
}
