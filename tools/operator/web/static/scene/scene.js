/**
 * The scene of a cell: arms, surroundings, frames, gaps, forces, target and handle.
 *
 * `createScene(element, description)` draws what `describe` of a cell tells, moved by the states
 * that `update` is given; `drawn` is how, as `createStage` is told.
 */

import { forward } from "./geometry/kinematics.js";
import { leadTo } from "./geometry/lead.js";
import { createTimeline } from "./geometry/timeline.js";
import { atRest, viewOf } from "./geometry/view.js";
import { THREE, createMaterials } from "./stage/kit.js";
import { createLabels } from "./stage/labels.js";
import { createStage } from "./stage/stage.js";
import { THEMES, themeName } from "./stage/theme.js";
import { VIEWS, createViews } from "./stage/views.js";
import { createArms } from "./things/arms.js";
import { createContour } from "./things/contour.js";
import { createForces } from "./things/forces.js";
import { createFrames } from "./things/frames.js";
import { createGaps } from "./things/gaps.js";
import { createHandle } from "./things/handle.js";
import { createPaths } from "./things/paths.js";
import { createScan } from "./things/scan.js";
import { createSurroundings } from "./things/surroundings.js";
import { createTunnels } from "./things/tunnels.js";

export { VIEWS };

export function createScene(element, description, drawn = {}) {
  const stage = createStage(element, drawn);
  const materials = createMaterials();
  const labels = createLabels(element, stage);
  const timeline = createTimeline();
  const start = forward(description, description.joints.map((joint) => joint.start));
  const scale = sizeOf(start);
  const arms = createArms(description, materials, stage.invalidate);
  const surroundings = createSurroundings(description, materials, labels);
  const tunnels = createTunnels(description, materials);
  const contour = createContour(description, materials);
  const scan = createScan(materials);
  const frames = createFrames(description, materials, labels, scale);
  const gaps = createGaps(description, materials, labels);
  const forces = createForces(description, materials, labels);
  const paths = createPaths(description, materials, labels, scale);
  const handle = createHandle(description, materials, stage, scale);
  const views = createViews(stage, stage.invalidate, surroundings.opaque);
  const parts = { arms, surroundings, tunnels, contour, scan, frames, gaps, forces, paths, handle };
  for (const part of Object.values(parts)) stage.scene.add(part.object);
  const bodies = [arms, surroundings, tunnels, frames];
  let current = null;
  let asked = null;
  const preference = globalThis.matchMedia?.("(prefers-color-scheme: light)");
  const follow = () => setOptions({ theme: asked });
  preference?.addEventListener("change", follow);

  show(atRest(description, start));
  frameAll();
  setOptions({ theme: null });
  views.go("home", false);
  stage.canvas.setAttribute("aria-label", `cell ${description.cell}: ${description.description}`);
  stage.controls.addEventListener("start", views.taken);
  arms.loaded.then(() => {
    frameAll();
    views.again();
  });

  let shown = null;
  let covered = false;
  let last = performance.now();
  let running = requestAnimationFrame(draw);

  function draw(now) {
    running = requestAnimationFrame(draw);
    if (covered) return;
    const dt = Math.min(0.1, (now - last) / 1000);
    last = now;
    const sample = timeline.sample(now / 1000);
    if (sample && !(shown && sample.time === shown)) {
      shown = sample.time;
      show(viewOf(description, sample));
      stage.invalidate();
    }
    views.step(dt, current.tasks[0].mrf);
    if (stage.draw(now)) labels.draw();
  }

  function show(view) {
    current = view;
    arms.pose(view.links, view.commanded, view.q);
    surroundings.pose(view, frames.lensAt);
    tunnels.pose(view);
    contour.pose(view);
    frames.pose(view);
    gaps.pose(view, surroundings.obstacles);
    forces.pose(view);
    paths.pose(view);
    handle.pose(view);
  }

  /** Lay ground and light, and set views, for all that is there. */
  function frameAll() {
    const points = bodies.flatMap(({ object }) => cornersOf(object));
    for (const camera of description.cameras) {
      points.push(new THREE.Vector3(...frames.lensAt(camera, current.links).slice(0, 3)));
    }
    const box = new THREE.Box3().setFromPoints(points);
    const sphere = box.getBoundingSphere(new THREE.Sphere());
    stage.ground.lay(sphere.center, Math.min(0, box.min.z), 3.4 * sphere.radius);
    stage.light(sphere.center, 1.05 * sphere.radius);
    const at = [...current.links, ...current.tasks.map(({ mrf }) => mrf)].filter(Boolean);
    views.around(points, at.map(([x, y, z]) => new THREE.Vector3(x, y, z)));
  }

  function setOptions(options) {
    if ("theme" in options) {
      asked = options.theme;
      const theme = THEMES[themeName(options.theme)];
      for (const part of [stage, materials, labels, ...Object.values(parts)]) part.setTheme?.(theme);
    }
    if ("view" in options) {
      frameAll();
      views.go(options.view, options.easing ?? true);
    }
    if ("covered" in options) covered = Boolean(options.covered);
    if ("ghost" in options) arms.showGhost = Boolean(options.ghost);
    if ("labels" in options) labels.show(options.labels);
    if ("frames" in options) frames.object.visible = Boolean(options.frames);
    if ("gaps" in options) gaps.object.visible = Boolean(options.gaps);
    if ("forces" in options) forces.object.visible = Boolean(options.forces);
    if ("trail" in options) paths.object.visible = Boolean(options.trail);
    if ("handle" in options) handle.setMode(options.handle, options.task);
    if ("handleSpace" in options) handle.setSpace(options.handleSpace);
    stage.invalidate();
  }

  return {
    /** Take in a message: `state`, `truth`, `obstacle` (news of one), `contour` or `scan`. */
    update(message) {
      if (message.type === "state") {
        timeline.push(message.t ?? message.state.time_s, message.state, performance.now() / 1000);
      } else if (message.type === "truth") {
        surroundings.truth(message.truth ?? message);
        stage.invalidate();
      } else if (message.type === "obstacle") {
        surroundings.news(message.obstacle ?? message);
        stage.invalidate();
      } else if (message.type === "contour") {
        contour.news(message.contour);
        stage.invalidate();
      } else if (message.type === "scan") {
        scan.news(message.scan);
        stage.invalidate();
      }
    },
    /** Show a state at once, without interpolation. */
    jump(state) {
      show(viewOf(description, { a: state, b: state, part: 1, time: state.time_s }));
      stage.invalidate();
    },
    /** Call back with `{type, phase, released, task, pose}` as the handle is dragged (start, move, end, abandoned); pose is xyz, rpy in World. */
    onTarget: (callback) => handle.onTarget(callback),
    /** End a drag of the handle without a target. */
    abandon: handle.abandon,
    leadTo,
    setOptions,
    /** Resolves once all meshes are there. */
    loaded: arms.loaded,
    upToDate: stage.upToDate,
    handleOnScreen: () => handle.onScreen(),
    /** Take up all room again after what is there has changed. */
    frame: frameAll,
    dispose() {
      cancelAnimationFrame(running);
      preference?.removeEventListener("change", follow);
      handle.dispose();
      labels.dispose();
      stage.dispose();
    },
  };
}

/** Return the corners of the boxes around all bodies of an object; ghosts, lines and walls are none. */
function cornersOf(object) {
  const corners = [];
  object.updateMatrixWorld(true);
  object.traverseVisible((part) => {
    if (!part.isMesh || part.userData.backdrop || !(part.castShadow || part.userData.body)) return;
    part.geometry.boundingBox ?? part.geometry.computeBoundingBox();
    const { min, max } = part.geometry.boundingBox;
    for (const x of [min.x, max.x]) for (const y of [min.y, max.y]) for (const z of [min.z, max.z]) {
      corners.push(new THREE.Vector3(x, y, z).applyMatrix4(part.matrixWorld));
    }
  });
  return corners;
}

/** Return a length to draw frames by: 1 for links that are within about a metre [m]. */
function sizeOf(links) {
  const box = new THREE.Box3().setFromPoints(links.map((T) => new THREE.Vector3(...T)));
  return Math.min(1.1, Math.max(0.2, box.getSize(new THREE.Vector3()).length() / 1.05));
}
