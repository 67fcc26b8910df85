/** Views: where the camera looks from, eased from one to another, and following the tool. */

import { THREE } from "./kit.js";

/** Directions from what is looked at to the camera. */
const FROM = {
  home: [1.0, -1.35, 0.78],
  front: [1, 0, 0.12],
  side: [0, -1, 0.12],
  top: [0.0001, -0.02, 1],
};
export const VIEWS = [...Object.keys(FROM), "follow"];
const EASE_S = 0.45;
/** Things fill the picture less by this factor. */
const ROOM = 1.12;

/** The first view is turned by these about the vertical until nothing hides the arm [rad]. */
const TURNS = [0, 1, -1, 2, -2, 3, -3, 4].map((step) => (step * Math.PI) / 4);
/** What stands this near before a point does not hide it [m]. */
const BEFORE = 0.08;

/** Views of a stage; the first one looks from where nothing `opaque` hides the arm. */
export function createViews(stage, invalidate, opaque = []) {
  const { camera, controls } = stage;
  const calm = globalThis.matchMedia?.("(prefers-reduced-motion: reduce)");
  let goal = null;
  let following = false;
  let points = [new THREE.Vector3()];
  let aims = [];
  let first = true;
  const last = new THREE.Vector3();

  /**
   * Return where the camera stands, and looks, to see all points from a direction as large as they
   * fit. With z towards the camera and t the tangent of half the view, a point is inside while
   * x + z t ≤ x0 + D t and −x + z t ≤ D t − x0: so the greatest of both give x0 and D.
   */
  function seen(direction) {
    const z = new THREE.Vector3(...direction).normalize();
    const x = new THREE.Vector3(0, 0, 1).cross(z).normalize();
    const y = z.clone().cross(x);
    const high = Math.tan(THREE.MathUtils.degToRad(0.5 * camera.fov)) / ROOM;
    const fit = (axis, t) => {
      const a = Math.max(...points.map((p) => p.dot(axis) + p.dot(z) * t));
      const b = Math.max(...points.map((p) => -p.dot(axis) + p.dot(z) * t));
      return [0.5 * (a - b), (a + b) / (2 * t)];
    };
    const [middleX, farX] = fit(x, high * camera.aspect);
    const [middleY, farY] = fit(y, high);
    const depth = points.reduce((sum, p) => sum + p.dot(z), 0) / points.length;
    const target = new THREE.Vector3()
      .addScaledVector(x, middleX).addScaledVector(y, middleY).addScaledVector(z, depth);
    const position = target.clone().addScaledVector(z, Math.max(0.3, farX - depth, farY - depth));
    return { position, target };
  }

  /** Return how many aims something hides from a place. */
  function hidden(place) {
    return aims.filter((aim) => {
      const way = aim.clone().sub(place);
      const ray = new THREE.Raycaster(place, way.clone().normalize(), 0, way.length() - BEFORE);
      return ray.intersectObjects(opaque, true).length > 0;
    }).length;
  }

  function home() {
    const [x, y, z] = FROM.home;
    const each = TURNS.map((turn) => {
      const [c, s] = [Math.cos(turn), Math.sin(turn)];
      const to = seen([c * x - s * y, s * x + c * y, z]);
      return { to, hides: hidden(to.position) };
    });
    return each.reduce((best, next) => (next.hides < best.hides ? next : best)).to;
  }

  return {
    /** Tell what there is to see: points, and of the arm those that nothing shall hide. */
    around(all, arm) { [points, aims] = [[...all, ...arm], arm]; },
    /** Take the first view anew, unless somebody chose another. */
    again() { if (first) this.go("home", false); },
    /** Go to a view by its name; at once without `easing`, and for who asks for little motion. */
    go(name, easing = true) {
      following = name === "follow";
      first = name === "home";
      if (!(name in FROM)) return;
      const to = name === "home" ? home() : seen(FROM[name]);
      if (!easing || calm?.matches) {
        camera.position.copy(to.position);
        controls.target.copy(to.target);
        controls.update();
        goal = null;
      } else {
        goal = { ...to, from: camera.position.clone(), looked: controls.target.clone(), part: 0 };
      }
      invalidate();
    },
    /** Ease on by a time [s]; follow the tool. */
    step(dt, tool) {
      if (following && tool) {
        const now = new THREE.Vector3(tool[0], tool[1], tool[2]);
        const aim = controls.target.clone().lerp(now, Math.min(1, 6 * dt));
        camera.position.add(aim).sub(controls.target);
        controls.target.copy(aim);
        if (last.distanceTo(aim) > 1e-5) invalidate();
        last.copy(aim);
      }
      if (!goal) return;
      goal.part = Math.min(1, goal.part + dt / EASE_S);
      const s = goal.part * goal.part * (3 - 2 * goal.part);
      camera.position.lerpVectors(goal.from, goal.position, s);
      controls.target.lerpVectors(goal.looked, goal.target, s);
      if (goal.part === 1) goal = null;
      invalidate();
    },
    /** The operator took the camera in hand. */
    taken() { [goal, first] = [null, false]; },
  };
}
