/** The kit that all parts are built from: materials that follow the theme, and shapes. */

import * as THREE from "../../vendor/three.module.js";

export { THREE };

/** Return materials by role; `setTheme` colours them all. */
export function createMaterials() {
  const roles = new Map();
  let theme = null;

  /** Return the material of a role; `make` builds it, `colour` reads its colour from a theme. */
  function material(role, make, colour) {
    if (!roles.has(role)) {
      const made = make();
      roles.set(role, { made, colour });
      if (theme) made.color?.set(colour(theme));
    }
    return roles.get(role).made;
  }

  const standard = (roughness, metalness, more = {}) =>
    () => new THREE.MeshStandardMaterial({ roughness, metalness, ...more });
  const glassy = (opacity, more = {}) => () => new THREE.MeshStandardMaterial({
    roughness: 0.25, metalness: 0, transparent: true, opacity, depthWrite: false, ...more,
  });

  return {
    material,
    shell: () => material("shell", standard(0.38, 0.04), (t) => t.shell),
    joint: () => material("joint", standard(0.5, 0.25), (t) => t.joint),
    accent: (i) => material(
      `accent${i % 4}`, standard(0.42, 0.1), (t) => t.accents[i % 4],
    ),
    metal: () => material("metal", standard(0.3, 0.85), (t) => t.metal),
    furniture: () => material("furniture", standard(0.8, 0), (t) => t.furniture),
    beam: () => material("beam", standard(0.6, 0.05), (t) => t.beam),
    wall: () => material("wall", standard(0.6, 0.1), (t) => t.wall),
    obstacle: () => material("obstacle", glassy(0.5), (t) => t.obstacle),
    glass: () => material("glass", glassy(0.22, { side: THREE.DoubleSide }), (t) => t.glass),
    line: (role, opacity = 1) => material(
      `line ${role} ${opacity}`,
      () => new THREE.LineBasicMaterial({ transparent: opacity < 1, opacity, depthWrite: opacity === 1 }),
      (t) => t[role],
    ),
    flat: (role, opacity = 1, depthTest = true) => material(
      `flat ${role} ${opacity} ${depthTest}`,
      () => new THREE.MeshBasicMaterial({
        transparent: opacity < 1 || !depthTest, opacity, depthTest, depthWrite: depthTest && opacity === 1,
        toneMapped: false,
      }),
      (t) => t[role],
    ),
    painted: (rgba) => material(
      `painted ${rgba.join(" ")}`,
      standard(0.5, 0.05, rgba[3] < 1 ? { transparent: true, opacity: rgba[3] } : {}),
      () => new THREE.Color().setRGB(rgba[0], rgba[1], rgba[2], THREE.SRGBColorSpace),
    ),
    setTheme(next) {
      theme = next;
      for (const { made, colour } of roles.values()) made.color?.set(colour(theme));
    },
  };
}

/** Return a mesh that casts and takes shadows. */
export function solid(geometry, material) {
  const mesh = new THREE.Mesh(geometry, material);
  mesh.castShadow = mesh.receiveShadow = true;
  return mesh;
}

/** Put an object at a pose `[x, y, z, qx, qy, qz, qw]`. */
export function place(object, T) {
  object.position.set(T[0], T[1], T[2]);
  object.quaternion.set(T[3], T[4], T[5], T[6]);
  return object;
}

/** Return a cylinder along z with rounded rims. */
export function cylinder(radius, length, rounding = 0.14 * radius, segments = 48) {
  const r = Math.min(rounding, 0.5 * length, radius);
  const points = [new THREE.Vector2(0, -length / 2)];
  for (let i = 0; i <= 4; i += 1) {
    const a = (i / 4) * (Math.PI / 2);
    points.push(new THREE.Vector2(radius - r + r * Math.sin(a), -length / 2 + r - r * Math.cos(a)));
  }
  for (let i = 0; i <= 4; i += 1) {
    const a = (i / 4) * (Math.PI / 2);
    points.push(new THREE.Vector2(radius - r + r * Math.cos(a), length / 2 - r + r * Math.sin(a)));
  }
  points.push(new THREE.Vector2(0, length / 2));
  return new THREE.LatheGeometry(points, segments).rotateX(Math.PI / 2);
}

/** Return a box with bevelled edges. */
export function box([x, y, z], rounding = 0.06 * Math.min(x, y, z)) {
  const r = Math.min(rounding, 0.02);
  const face = new THREE.Shape();
  face.moveTo(-x + r, -y);
  face.lineTo(x - r, -y).quadraticCurveTo(x, -y, x, -y + r);
  face.lineTo(x, y - r).quadraticCurveTo(x, y, x - r, y);
  face.lineTo(-x + r, y).quadraticCurveTo(-x, y, -x, y - r);
  face.lineTo(-x, -y + r).quadraticCurveTo(-x, -y, -x + r, -y);
  const geometry = new THREE.ExtrudeGeometry(face, {
    depth: 2 * (z - r), bevelEnabled: true, bevelThickness: r, bevelSize: r, bevelOffset: -r,
    bevelSegments: 2, curveSegments: 3,
  });
  return geometry.translate(0, 0, -(z - r));
}

/** Turn an object's z along a direction, from a place. */
export function lay(object, from, to) {
  const way = new THREE.Vector3(to[0] - from[0], to[1] - from[1], to[2] - from[2]);
  const length = way.length();
  object.position.set(from[0], from[1], from[2]);
  if (length > 1e-9) {
    object.quaternion.setFromUnitVectors(new THREE.Vector3(0, 0, 1), way.divideScalar(length));
  }
  return length;
}
