/** Arms as they are measured, and their commanded pose as a ghost where that is elsewhere. */

import { THREE, box, cylinder, place, solid } from "../stage/kit.js";
import { loadMesh } from "./meshes.js";

/** The ghost appears where a link is off by this, and is full at thrice as much [m]. */
const GHOST_FROM = 0.006;
/** A link that is nearer to its ghost than this has none [m], [rad]. */
const LEAST_OFF = 0.0015;
const LEAST_TURN = 0.004;
/** A joint this near to its bound, in parts of its range, is coloured. */
const NEAR_BOUND = 0.04;

export function createArms(description, materials, invalidate) {
  const object = new THREE.Group();
  const ghostMaterial = materials.material("ghost", () => new THREE.MeshStandardMaterial({
    transparent: true, opacity: 0, roughness: 0.6, depthWrite: false, emissiveIntensity: 0.3,
  }), (theme) => theme.ghost);
  const bounds = ["warning", "danger"].map((role) => materials.material(
    `bound ${role}`, () => new THREE.MeshStandardMaterial({ roughness: 0.5 }), (t) => t[role],
  ));
  const roots = description.links.flatMap((link, i) => (link.parent < 0 ? [i] : []));
  const carrierOf = (link) => {
    let i = link;
    while (i >= 0 && description.links[i].joint < 0) i = description.links[i].parent;
    return i;
  };
  const hands = new Set(description.tasks.map(({ tip }) => carrierOf(tip)));
  let arm = -1;
  const loading = [];
  const links = description.links.map((link, i) => {
    if (roots.includes(i)) arm += 1;
    const own = new THREE.Group();
    const ghost = new THREE.Group();
    const caps = jointCaps(description, i);
    const tool = hands.has(carrierOf(i));
    const bare = tool ? materials.joint() : materials.shell();
    loading.push(...dress(own, solidOf(description, link), invalidate, (colour) => (
      colour ? materials.painted(colour) : bare), true));
    loading.push(...dress(ghost, link, invalidate, () => ghostMaterial, false));
    const marks = caps.map((cap) => place(solid(cap.geometry, materials.joint()), cap.pose));
    const faces = caps.flatMap((cap) => cap.faces.map(
      (face) => place(solid(cap.face, materials.accent(arm)), face),
    ));
    for (const part of [...marks, ...faces]) own.add(part);
    ghost.visible = false;
    object.add(own, ghost);
    return { link, own, ghost, marks, faces, accent: materials.accent(arm) };
  });

  return {
    object,
    showGhost: true,
    /** Resolves once all meshes are there. */
    loaded: Promise.all(loading),
    /** Put links at poses of measured and of commanded joints. */
    pose(measured, commanded, q) {
      let most = 0;
      links.forEach(({ own, ghost }, i) => {
        place(own, measured[i]);
        place(ghost, commanded[i]);
        most = Math.max(most, own.position.distanceTo(ghost.position));
      });
      const strength = this.showGhost ? Math.min(1, Math.max(0, most / GHOST_FROM - 1) / 2) : 0;
      ghostMaterial.opacity = 0.34 * strength;
      for (const { own, ghost } of links) {
        const elsewhere = own.position.distanceTo(ghost.position) > LEAST_OFF
          || own.quaternion.angleTo(ghost.quaternion) > LEAST_TURN;
        ghost.visible = strength > 0.02 && elsewhere;
      }
      for (const { link, faces, accent } of links) {
        const mark = boundOf(description.joints[link.joint], q[link.joint]);
        for (const face of faces) face.material = mark < 0 ? accent : bounds[mark];
      }
    },
    setTheme(theme) { ghostMaterial.emissive.set(theme.ghost); },
  };
}

/** Return 0 where a joint is near a bound, 1 where it is at it, else −1. */
function boundOf(joint, way) {
  if (!joint || joint.lower === null || !Number.isFinite(way)) return -1;
  const room = Math.min(way - joint.lower, joint.upper - way) / (joint.upper - joint.lower);
  if (room > NEAR_BOUND) return -1;
  return room > 0.15 * NEAR_BOUND ? 0 : 1;
}

/**
 * Add a link's shapes to a group, each of the material of its colour; return promises of those that
 * load. A mesh's own colours win over the URDF's.
 */
function dress(group, link, done, materialOf, shadows) {
  const loading = [];
  for (const shape of link.shapes) {
    const add = (geometry, colour) => {
      const mesh = solid(geometry, materialOf(colour));
      mesh.castShadow = mesh.receiveShadow = shadows;
      group.add(place(mesh, shape.pose));
      return mesh;
    };
    if (shape.kind === "mesh") {
      loading.push(loadMesh(shape.url).then((parts) => {
        for (const { geometry, colour } of parts) {
          add(geometry, colour ?? shape.colour).scale.set(...shape.scale);
        }
        done();
      }, (error) => globalThis.console?.warn(`${link.name}: ${error.message}`)));
    } else {
      add(geometryOf(shape), shape.colour);
    }
  }
  return loading;
}

/** Return a link; one that turns for ever is a wheel, whose ball becomes a tyre about its axis. */
function solidOf(description, link) {
  if (link.joint < 0 || description.joints[link.joint].lower !== null) return link;
  const turn = new THREE.Quaternion()
    .setFromUnitVectors(new THREE.Vector3(0, 0, 1), new THREE.Vector3(...link.axis)).toArray();
  const tyre = (shape) => [
    { radius: shape.radius, length: 0.55 * shape.radius, colour: [0.04, 0.045, 0.05, 1] },
    { radius: 0.58 * shape.radius, length: 0.62 * shape.radius, colour: [0.5, 0.53, 0.56, 1] },
  ].map((part) => ({ ...part, kind: "cylinder", pose: [...shape.pose.slice(0, 3), ...turn] }));
  return { ...link, shapes: link.shapes.flatMap((s) => (s.kind === "sphere" ? tyre(s) : [s])) };
}

function geometryOf(shape) {
  switch (shape.kind) {
    case "sphere": return new THREE.SphereGeometry(shape.radius, 48, 32);
    case "cylinder": return cylinder(shape.radius, shape.length);
    case "capsule":
      return new THREE.CapsuleGeometry(shape.radius, shape.length, 12, 40).rotateX(Math.PI / 2);
    default: return box(shape.half_size);
  }
}

/** A ball is on a joint's axis that is nearer to it [m], and not farther along it than this. */
const ON_AXIS = 0.01;
const ALONG_AXIS = 0.3;

/**
 * Return a dark drum with a coloured face at either end, around a ball (of the link or of the one
 * before) on the axis of a joint that bends the arm; none for one that turns it about its length.
 */
function jointCaps(description, index) {
  const link = description.links[index];
  if (link.kind !== "revolute" || description.joints[link.joint].lower === null) return [];
  const before = description.links[link.parent];
  const inverse = new THREE.Quaternion(...link.pose.slice(3)).invert();
  const origin = new THREE.Vector3(...link.pose);
  const axis = new THREE.Vector3(...link.axis);
  const shapes = [
    ...link.shapes.map((shape) => ({
      shape, at: new THREE.Vector3(...shape.pose), along: directionOf(shape),
    })),
    ...before.shapes.map((shape) => ({
      shape,
      at: new THREE.Vector3(...shape.pose).sub(origin).applyQuaternion(inverse),
      along: directionOf(shape).applyQuaternion(inverse),
    })),
  ];
  const bends = shapes.some(({ shape, along }) => (
    shape.kind === "cylinder" && Math.abs(along.dot(axis)) < 0.1));
  const balls = shapes.filter(({ shape, at }) => shape.kind === "sphere"
    && Math.abs(at.dot(axis)) < ALONG_AXIS
    && at.clone().addScaledVector(axis, -at.dot(axis)).length() < ON_AXIS);
  if (!bends || !balls.length) return [];
  const { shape, at } = balls.reduce((a, b) => (b.shape.radius > a.shape.radius ? b : a));
  const turn = new THREE.Quaternion().setFromUnitVectors(new THREE.Vector3(0, 0, 1), axis);
  return [drum(0.74 * shape.radius, 2.14 * shape.radius, [...at.toArray(), ...turn.toArray()])];
}

function directionOf(shape) {
  return new THREE.Vector3(0, 0, 1).applyQuaternion(new THREE.Quaternion(...shape.pose.slice(3)));
}

/** Return a drum of a length along z of a pose, with a coloured face sunk into either end. */
function drum(radius, length, pose) {
  const z = new THREE.Vector3(0, 0, 1).applyQuaternion(new THREE.Quaternion(...pose.slice(3)));
  const faces = [-1, 1].map((side) => {
    const p = z.clone().multiplyScalar(side * (length / 2 + 0.0005));
    return [pose[0] + p.x, pose[1] + p.y, pose[2] + p.z, ...pose.slice(3)];
  });
  return {
    geometry: cylinder(radius, length, 0.12 * radius),
    pose,
    face: cylinder(0.62 * radius, 0.004, 0.001),
    faces,
  };
}
