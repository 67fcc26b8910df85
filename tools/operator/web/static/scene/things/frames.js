/** Named frames as triads: MRF, CRF, Base, Carrier and the Lens of each camera, with its view. */

import { THREE, lay, place } from "../stage/kit.js";
import { composed, fromRpy } from "../geometry/poses.js";

const AXES = [["x", [1, 0, 0]], ["y", [0, 1, 0]], ["z", [0, 0, 1]]];

/** Return three arrows of a length [m] along the axes. */
export function triad(length, materials, opacity = 1) {
  const group = new THREE.Group();
  const rod = new THREE.CylinderGeometry(0.022 * length, 0.022 * length, 0.8 * length, 12)
    .rotateX(Math.PI / 2).translate(0, 0, 0.4 * length);
  const tip = new THREE.ConeGeometry(0.06 * length, 0.2 * length, 16)
    .rotateX(Math.PI / 2).translate(0, 0, 0.9 * length);
  for (const [role, direction] of AXES) {
    const arrow = new THREE.Group();
    const material = materials.flat(role, opacity);
    arrow.add(new THREE.Mesh(rod, material), new THREE.Mesh(tip, material));
    lay(arrow, [0, 0, 0], direction);
    group.add(arrow);
  }
  return group;
}

export function createFrames(description, materials, labels, scale) {
  const object = new THREE.Group();
  const several = description.tasks.length > 1;
  const name = (frame, of) => (several && of ? `${frame} ${of}` : frame);
  const named = (words, length, rank) => {
    const group = triad(length, materials, rank > 2 ? 1 : 0.8);
    // Of frames, the tool's has to be in the picture, too.
    group.traverse((part) => { part.userData.body = rank > 2; });
    object.add(group);
    const label = labels.add(words, { rank });
    return {
      group,
      to(T) {
        group.visible = Boolean(T);
        if (T) place(group, T);
        label.at(T);
      },
    };
  };
  const roots = description.links.flatMap((link, i) => (link.parent < 0 ? [i] : []));
  const arms = description.tasks.filter((task) => task.by.length === 1);
  const bases = roots.map((root, i) => named(name("Base", arms[i]?.name), 0.11 * scale, 1));
  const mrfs = description.tasks.map((task) => named(name("MRF", task.name), 0.1 * scale, 5));
  const crfs = description.tasks.map((task, i) => named(i ? `CRF ${task.name}` : "CRF", 0.13 * scale, 2));
  const carrier = description.moving.includes("carrier") ? named("Carrier", 0.13 * scale, 2) : null;
  const lenses = description.cameras.map((camera) => ({
    camera, ...named(`Lens ${camera.name}`, 0.06 * scale, 2), view: frustum(camera, materials, scale),
  }));
  for (const lens of lenses) object.add(lens.view);

  /** Return where the Lens of a camera is. */
  function lensAt(camera, links) {
    const task = description.tasks.find((t) => t.name === camera.task);
    if (camera.on === "world") return camera.pose;
    if (camera.on === "wrist") return composed(links[task.tip], camera.pose);
    let root = task.tip;
    while (description.links[root].parent >= 0) root = description.links[root].parent;
    return composed(links[root], camera.pose);
  }

  return {
    object,
    lensAt,
    pose(view) {
      roots.forEach((root, i) => bases[i].to(view.links[root]));
      mrfs.forEach((mrf, i) => mrf.to(view.tasks[i].held ? null : view.tasks[i].mrf));
      const shared = view.tasks[0].crf;
      // Those of other tasks are drawn where they are elsewhere.
      crfs.forEach((crf, i) => {
        const { held, crf: own } = view.tasks[i];
        crf.to(i && (held || String(own) === String(shared)) ? null : own ?? null);
      });
      carrier?.to(view.carrier ?? fromRpy([0, 0, 0, 0, 0, 0]));
      for (const lens of lenses) {
        const T = lensAt(lens.camera, view.links);
        lens.to(T);
        place(lens.view, T);
      }
    },
  };
}

/** Return a camera's field of view as a thin pyramid with a body behind it. */
function frustum(camera, materials, scale) {
  const [w, h] = camera.size;
  const far = 0.16 * scale;
  const [x, y] = [(0.5 * w * far) / camera.focal[0], (0.5 * h * far) / camera.focal[1]];
  const corners = [[-x, -y, far], [x, -y, far], [x, y, far], [-x, y, far]];
  const points = corners.flatMap((corner, i) => [
    [0, 0, 0], corner, corner, corners[(i + 1) % 4],
  ]);
  // a small mark at the upper side of the picture
  points.push([-0.2 * x, -y, far], [0, -1.25 * y, far], [0, -1.25 * y, far], [0.2 * x, -y, far]);
  const geometry = new THREE.BufferGeometry()
    .setFromPoints(points.map((p) => new THREE.Vector3(...p)));
  const group = new THREE.Group();
  group.add(new THREE.LineSegments(geometry, materials.line("sight", 0.75)));
  const body = new THREE.Mesh(
    new THREE.BoxGeometry(0.03, 0.03, 0.035).translate(0, 0, -0.02), materials.joint(),
  );
  body.castShadow = true;
  group.add(body);
  return group;
}
