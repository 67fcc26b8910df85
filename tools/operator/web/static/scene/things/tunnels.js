/** Tunnels: glass walls on either side of a planar arm, and a ribbed tube around one in space. */

import { centreLine } from "../geometry/tunnel.js";
import { THREE } from "../stage/kit.js";

export function createTunnels(description, materials) {
  const object = new THREE.Group();
  const drawn = description.tunnels.map((tunnel) => {
    const group = new THREE.Group();
    object.add(group);
    draw(group, tunnel, tunnel.pieces, materials);
    const task = description.tasks.findIndex(({ name }) => name === tunnel.task);
    return { tunnel, group, task, told: "null" };
  });
  return {
    object,
    /** Draw anew what an operator told an arm of its tunnel. */
    pose(view) {
      for (const each of drawn) {
        const next = view.tasks[each.task]?.tunnel ?? null;
        const told = JSON.stringify(next);
        if (told === each.told) continue;
        each.told = told;
        const { pieces, step } = each.tunnel;
        const rows = next ? centreLine(pieces[0][0], next.pieces, next.open, step) : pieces;
        draw(each.group, each.tunnel, rows, materials);
      }
    },
  };
}

function draw(group, tunnel, pieces, materials) {
  for (const part of group.children) part.geometry.dispose();
  group.clear();
  for (const piece of pieces) {
    const frames = piece.map((n) => ({ p: n.slice(0, 3), y: n.slice(3, 6), z: n.slice(6, 9) }));
    if (frames.length < 2) continue;
    const parts = tunnel.planar ? walls(frames, tunnel, materials) : tube(frames, tunnel, materials);
    for (const part of parts) {
      part.userData.body = part.isMesh;
      group.add(part);
    }
  }
}

const at = ({ p, y, z }, a, b) => [0, 1, 2].map((i) => p[i] + a * y[i] + b * z[i]);

/** Return a surface through rows of points, each row as long. */
function surface(rows) {
  const n = rows[0].length;
  const index = [];
  for (let i = 0; i + 1 < rows.length; i += 1) {
    for (let k = 0; k + 1 < n; k += 1) {
      const a = i * n + k;
      index.push(a, a + n, a + 1, a + 1, a + n, a + n + 1);
    }
  }
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.Float32BufferAttribute(rows.flat(2), 3));
  geometry.setIndex(index);
  geometry.computeVertexNormals();
  return geometry;
}

const line = (points, material) => new THREE.Line(
  new THREE.BufferGeometry().setFromPoints(points.map((p) => new THREE.Vector3(...p))), material,
);

function walls(frames, tunnel, materials) {
  const { half_width: w, thickness: t, half_height: h } = tunnel;
  const parts = [];
  const low = -h;
  for (const side of [1, -1]) {
    const [near, far] = [side * w, side * (w + t)];
    parts.push(new THREE.Mesh(surface(frames.map((f) => [
      at(f, near, low), at(f, near, h), at(f, far, h), at(f, far, low),
    ])), materials.glass()));
    for (const edge of [near, far]) {
      parts.push(line(frames.map((f) => at(f, edge, h)), materials.line("glass", 0.95)));
      parts.push(line(frames.map((f) => at(f, edge, low)), materials.line("glass", 0.4)));
    }
    for (const end of [frames[0], frames.at(-1)]) {
      parts.push(line([at(end, near, low), at(end, near, h), at(end, far, h), at(end, far, low)],
        materials.line("glass", 0.8)));
    }
  }
  return parts;
}

function tube(frames, tunnel, materials) {
  const { half_width: w } = tunnel;
  const sides = 40;
  const ring = (frame, r) => Array.from({ length: sides + 1 }, (_, k) => {
    const angle = (2 * Math.PI * k) / sides;
    return at(frame, r * Math.cos(angle), r * Math.sin(angle));
  });
  const parts = [new THREE.Mesh(surface(frames.map((frame) => ring(frame, w))), materials.glass())];
  frames.forEach((frame, i) => {
    const end = i === 0 || i === frames.length - 1;
    if (!end && i % 6) return;
    parts.push(line(ring(frame, w), materials.line("glass", end ? 0.95 : 0.4)));
  });
  return parts;
}
