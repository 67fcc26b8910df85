/** Surroundings: obstacles, sight lines, workspace, and the bodies of the virtual world. */

import { THREE, box, cylinder, lay, place, solid } from "../stage/kit.js";
import { composed, fromRpy, placed } from "../geometry/poses.js";

export function createSurroundings(description, materials, labels) {
  const object = new THREE.Group();
  const rig = description.rig ?? {};
  const opaque = (rig.boxes ?? []).map(
    (each) => place(solid(box(each.half_size), materials.furniture()), each.pose),
  );
  if (rig.wall) {
    const { half_size: half } = rig.wall;
    const plate = solid(box([half, half, 0.02]).translate(0, 0, -0.02), materials.wall());
    plate.userData.backdrop = true;
    opaque.push(place(plate, rig.wall.pose));
  }
  opaque.push(...(rig.holes ?? []).map((hole) => place(block(hole, materials), hole.pose)));
  if (opaque.length) object.add(...opaque);
  const tags = (rig.tags ?? []).map((tag) => ({ tag, sheet: sheet(tag) }));
  for (const { tag, sheet: shown } of tags) object.add(place(shown, tag.pose));
  if (description.workspace) object.add(space(description.workspace, materials));
  for (const each of description.tool_planes ?? []) object.add(plane(each, materials));
  const obstacles = new Map();
  for (const each of description.obstacles) {
    const made = obstacle(each, materials, labels);
    obstacles.set(each.name, made);
    object.add(made.object);
  }
  const beam = rig.beam ? payload(rig.beam, materials) : null;
  if (beam) object.add(beam);
  const pegs = rig.peg ? description.tasks.map(() => tool(rig.peg, materials)) : [];
  if (pegs.length) object.add(...pegs);
  const probes = rig.tool_radius && !rig.peg
    ? description.tasks.filter((task) => task.by.length === 1)
      .map((task) => ({ task, stick: probe(task, rig.tool_radius, materials) })) : [];
  if (probes.length) object.add(...probes.map(({ stick }) => stick));

  return {
    object,
    /** What hides whatever is behind it. */
    opaque,
    /** Shapes that gaps are told to, by name: `{shape, xyz, to, pose, half_size, radius}`. */
    obstacles,
    /** Take in news of an obstacle, or its removal; one that only moves is not made anew. */
    news(message) {
      const old = obstacles.get(message.name);
      const given = Object.fromEntries(Object.entries(message).filter(([, v]) => v !== null));
      const base = message.shape ? { rpy: [0, 0, 0], radius: 0 } : old?.told;
      if (message.remove || !base) {
        old?.remove();
        obstacles.delete(message.name);
        return;
      }
      const next = { ...base, ...given };
      if (old?.moved(next)) return;
      old?.remove();
      const made = obstacle(next, materials, labels);
      obstacles.set(next.name, made);
      object.add(made.object);
    },
    /** Take in the rig's truth: tags that were moved, and the payload. */
    truth(told) {
      for (const { tag, sheet: shown } of tags) {
        if (told.tags?.[tag.name]) place(shown, fromRpy(told.tags[tag.name]));
        shown.visible = !told.covered?.includes(tag.name);
      }
    },
    pose(view, lensAt) {
      for (const { tag, sheet: shown } of tags) {
        const by = description.tasks.find((task) => task.mechanism === tag.mechanism)
          ?? description.tasks[0];
        if (tag.on === "wrist") place(shown, composed(view.links[by.tip], tag.pose));
      }
      for (const each of obstacles.values()) each.look(view, lensAt);
      if (beam) {
        const shared = view.tasks.at(-1);
        const T = shared.mrf ?? view.tasks[0].mrf;
        beam.visible = Boolean(T);
        if (T) place(beam, T);
      }
      for (const { task, stick } of probes) place(stick, view.links[task.tip]);
      pegs.forEach((peg, i) => view.tasks[i].mrf && place(peg, view.tasks[i].mrf));
    },
  };
}

/** Return something to keep clear of: glassy, with its edges drawn. */
function obstacle(told, materials, labels) {
  const object = new THREE.Group();
  const line = told.shape === "sight_line";
  const label = labels.add(told.name, { rank: 1, role: line ? "sight" : "obstacle" });
  const made = {
    told,
    object,
    moved: () => false,
    remove() {
      object.removeFromParent();
      object.traverse((part) => part.geometry?.dispose());
      label.remove();
    },
  };
  if (line) {
    const beam = new THREE.Mesh(
      new THREE.CylinderGeometry(1, 1, 1, 20, 1, true).rotateX(Math.PI / 2).translate(0, 0, 0.5),
      materials.flat("sight", 0.3),
    );
    object.add(beam);
    made.look = (view, lensAt) => {
      const camera = view.description.cameras.find((c) => c.name === told.camera);
      const from = camera ? lensAt(camera, view.links) : told.xyz;
      made.from = [from[0], from[1], from[2]];
      const length = lay(beam, from, told.to);
      const radius = Math.max(told.radius, 0.004);
      beam.scale.set(radius, radius, length);
      label.at([0, 1, 2].map((i) => 0.5 * (from[i] + told.to[i])));
    };
    return made;
  }
  const geometry = outline(told);
  const body = new THREE.Mesh(geometry, materials.obstacle());
  body.castShadow = true;
  const sharp = told.shape === "box"
    ? new THREE.BoxGeometry(...told.half_size.map((x) => 2 * x + 0.002)) : geometry;
  const edges = new THREE.LineSegments(
    new THREE.EdgesGeometry(sharp, 30), materials.line("obstacle", 0.9),
  );
  object.add(body, edges);
  let top = 0;
  const put = (next) => {
    made.told = next;
    made.pose = next.shape === "capsule" ? null : fromRpy([...next.xyz, ...next.rpy]);
    if (made.pose) place(object, made.pose);
    else lay(object, next.xyz, next.to);
    top = topOf(next, made.pose);
  };
  /** Move it if that is all that is new; return whether it is. */
  made.moved = (next) => {
    const same = ["shape", "radius", "half_size"].every((key) => String(next[key]) === String(told[key]))
      && Math.abs(lengthOf(next) - lengthOf(told)) < 1e-4;
    if (same) put(next);
    return same;
  };
  made.look = () => {
    const { xyz, to = null } = made.told;
    label.at([0, 1].map((i) => 0.5 * (xyz[i] + (to ?? xyz)[i])).concat(top));
  };
  put(told);
  return made;
}

const lengthOf = ({ xyz, to }) => (to ? Math.hypot(...[0, 1, 2].map((i) => to[i] - xyz[i])) : 0);

/** Return how high something reaches [m]. */
function topOf({ shape, xyz, to, radius, half_size: half }, T) {
  if (shape !== "box") return Math.max(xyz[2], (to ?? xyz)[2]) + radius;
  const corners = [-1, 1].flatMap((a) => [-1, 1].flatMap((b) => [-1, 1].map((c) => [a, b, c])));
  return Math.max(...corners.map((corner) => placed(T, half.map((x, i) => x * corner[i]))[2]));
}

function outline(told) {
  if (told.shape === "box") return box(told.half_size.map((x) => x + 0.001), 0.004);
  if (told.shape === "capsule") {
    const length = lengthOf(told);
    return new THREE.CapsuleGeometry(told.radius, length, 12, 32)
      .rotateX(Math.PI / 2).translate(0, 0, length / 2);
  }
  return new THREE.SphereGeometry(Math.max(told.radius, 0.01), 40, 28);
}

/** Return a block with a chamfered hole, its mouth up. */
function block(hole, materials) {
  const { half_size: a, radius: r, chamfer: c, depth } = hole;
  const part = (radius, height) => {
    const face = new THREE.Shape();
    face.moveTo(-a, -a).lineTo(a, -a).lineTo(a, a).lineTo(-a, a).lineTo(-a, -a);
    face.holes.push(new THREE.Path().absarc(0, 0, radius, 0, 2 * Math.PI, true));
    return new THREE.ExtrudeGeometry(face, { depth: height, bevelEnabled: false, curveSegments: 24 });
  };
  const group = new THREE.Group();
  group.add(
    solid(part(r, depth - c).translate(0, 0, -depth), materials.metal()),
    solid(part(r + c, c).translate(0, 0, -c), materials.metal()),
    solid(new THREE.CylinderGeometry(r + c, r, c, 32, 1, true).rotateX(Math.PI / 2)
      .translate(0, 0, -c / 2), materials.joint()),
  );
  return group;
}

/** Return a printed tag on its panel. */
function sheet(tag) {
  const group = new THREE.Group();
  const cells = tag.cells ?? [[1, 1, 1], [1, 0, 1], [1, 1, 1]];
  const n = cells.length;
  const side = tag.cells ? (tag.size * n) / (n - 2) : tag.size * 3;
  const data = new Uint8Array(n * n * 4);
  cells.flat().forEach((white, i) => {
    const row = n - 1 - Math.floor(i / n);
    data.set([...Array(3).fill(white ? 245 : 20), 255], 4 * (row * n + (i % n)));
  });
  const map = new THREE.DataTexture(data, n, n);
  map.magFilter = THREE.NearestFilter;
  map.colorSpace = THREE.SRGBColorSpace;
  map.needsUpdate = true;
  const face = solid(
    new THREE.PlaneGeometry(side, side).translate(0, 0, 0.0005),
    new THREE.MeshStandardMaterial({ map, roughness: 0.9 }),
  );
  const half = 0.5 * side + 0.004;
  const back = solid(
    box([half, half, 0.004], 0.002).translate(0, 0, -0.0045),
    new THREE.MeshStandardMaterial({ color: new THREE.Color(...tag.colour), roughness: 0.8 }),
  );
  group.add(back, face);
  return group;
}

/** Return the box that the MRF stays in: thin edges, strong corners. */
function space({ low, high }, materials) {
  const middle = low.map((x, i) => 0.5 * (x + high[i]));
  const half = low.map((x, i) => 0.5 * (high[i] - x));
  const group = new THREE.Group();
  const edges = new THREE.EdgesGeometry(new THREE.BoxGeometry(...half.map((x) => 2 * x)));
  group.add(new THREE.LineSegments(edges, materials.line("space", 0.28)));
  const points = [];
  const reach = 0.16 * Math.min(...half);
  for (const sx of [-1, 1]) for (const sy of [-1, 1]) for (const sz of [-1, 1]) {
    const corner = [sx * half[0], sy * half[1], sz * half[2]];
    [sx, sy, sz].forEach((s, k) => {
      const inward = [...corner];
      inward[k] -= s * reach;
      points.push(new THREE.Vector3(...corner), new THREE.Vector3(...inward));
    });
  }
  group.add(new THREE.LineSegments(
    new THREE.BufferGeometry().setFromPoints(points), materials.line("space", 0.95),
  ));
  group.position.set(...middle);
  return group;
}

/** Return a plane that the MRF stays above: a grid, and a line to its free side. */
function plane({ point, normal }, materials) {
  const [half, step] = [0.6, 0.15];
  const points = [new THREE.Vector3(0, 0, 0), new THREE.Vector3(0, 0, step)];
  for (let x = -half; x <= half + 1e-9; x += step) {
    points.push(new THREE.Vector3(x, -half, 0), new THREE.Vector3(x, half, 0));
    points.push(new THREE.Vector3(-half, x, 0), new THREE.Vector3(half, x, 0));
  }
  const grid = new THREE.LineSegments(
    new THREE.BufferGeometry().setFromPoints(points), materials.line("space", 0.5),
  );
  grid.position.set(...point);
  const up = new THREE.Vector3(0, 0, 1);
  grid.quaternion.setFromUnitVectors(up, new THREE.Vector3(...normal).normalize());
  return grid;
}

/** Return the stick with a ball that touches the virtual world at the MRF, from the wrist. */
function probe(task, radius, materials) {
  const stick = new THREE.Group();
  const end = task.T_wrist_mrf.slice(0, 3);
  const ball = solid(new THREE.SphereGeometry(radius, 24, 16), materials.metal());
  ball.position.set(...end);
  stick.add(ball);
  const rod = new THREE.Group();
  const length = lay(rod, [0, 0, 0], end);
  if (length > radius) {
    rod.add(solid(cylinder(0.6 * radius, length, 0).translate(0, 0, length / 2), materials.metal()));
    stick.add(rod);
  }
  return stick;
}

function tool(peg, materials) {
  const group = new THREE.Group();
  group.add(solid(
    cylinder(peg.radius, peg.length, 0.2 * peg.radius).translate(0, 0, -peg.length / 2),
    materials.metal(),
  ));
  return group;
}

/** Return the payload that arms hold together, with its pegs: x out of them. */
function payload(beam, materials) {
  const group = new THREE.Group();
  group.add(solid(box(beam.half_size, 0.012), materials.beam()));
  for (const peg of beam.pegs) {
    const rod = cylinder(beam.peg.radius, beam.peg.length, 0.2 * beam.peg.radius)
      .rotateY(Math.PI / 2).translate(-beam.peg.length / 2, 0, 0);
    group.add(place(solid(rod, materials.metal()), peg));
  }
  return group;
}
