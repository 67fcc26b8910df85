/** The stage: renderer, camera, light, shadows and ground; draws only when something has changed. */

import * as THREE from "../../vendor/three.module.js";
import { OrbitControls } from "../../vendor/OrbitControls.js";
import { RoomEnvironment } from "../../vendor/RoomEnvironment.js";
import { createCompiler } from "./compiler.js";
import { createGround } from "./ground.js";
import { createPace, fenceOf } from "./pace.js";

/** Pictures that take longer [ms], so many more often than not, are drawn more coarsely. */
const SLOW_MS = 45;
const STILL_SLOW_PICTURES = 8;
const FINE_SHADOWS = 2048;
const COARSE_SHADOWS = 512;
/** Light from all around, in parts of what the room would reflect, where there is no room. */
const INSTEAD_OF_ROOM = 1.6;

/** Renderers that draw with the processor: Chromium's, Mesa's, and those of Windows and macOS. */
const BY_PROCESSOR = /swiftshader|llvmpipe|softpipe|basic render|software/i;

/** `fine`: as finely as there is, however long it takes; else as finely as this browser can soon. */
export function createStage(element, { fine = false } = {}) {
  const plain = !fine && BY_PROCESSOR.test(rendererName());
  const renderer = new THREE.WebGLRenderer({ antialias: !plain, alpha: true });
  // To ask after errors is to wait for the compiler; the browser's console tells of them, too.
  renderer.debug.checkShaderErrors = false;
  renderer.toneMapping = THREE.ACESFilmicToneMapping;
  renderer.shadowMap.enabled = true;
  renderer.shadowMap.type = THREE.PCFShadowMap;
  renderer.setPixelRatio(Math.min(globalThis.devicePixelRatio || 1, 2));
  const canvas = renderer.domElement;
  canvas.className = "scene-canvas";
  canvas.tabIndex = -1;
  canvas.setAttribute("role", "img");
  Object.assign(canvas.style, { display: "block", width: "100%", height: "100%", outline: "none" });
  if (getComputedStyle(element).position === "static") element.style.position = "relative";
  element.style.overflow = "hidden";
  element.append(canvas);

  const scene = new THREE.Scene();
  scene.environmentRotation.set(Math.PI / 2, 0, 0);

  const camera = new THREE.PerspectiveCamera(36, 1, 0.01, 100);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, canvas);
  controls.enableDamping = true;
  controls.dampingFactor = 0.12;
  controls.screenSpacePanning = true;
  controls.minDistance = 0.08;
  controls.maxDistance = 25;

  const key = new THREE.DirectionalLight(0xfff4e2, 2.4);
  key.castShadow = !plain;
  key.shadow.mapSize.set(FINE_SHADOWS, FINE_SHADOWS);
  key.shadow.bias = -0.0004;
  key.shadow.normalBias = 0.012;
  key.shadow.radius = 5;
  const rim = new THREE.DirectionalLight(0xbfd8ff, 0.7);
  const fill = new THREE.HemisphereLight(0xdfeaff, 0x4a4640, 0.6);
  const ground = createGround();
  scene.add(key, key.target, rim, rim.target, fill, ground.object);

  const fence = fenceOf(renderer.getContext());
  const pace = createPace(fence);
  const compiler = createCompiler(renderer, scene, camera, fence);
  let changed = true;
  let slow = 0;
  let width = 1;
  let height = 1;
  const invalidate = () => { changed = true; };
  controls.addEventListener("change", invalidate);

  function resize() {
    [width, height] = [Math.max(1, element.clientWidth), Math.max(1, element.clientHeight)];
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    invalidate();
  }
  const observer = new ResizeObserver(resize);
  observer.observe(element);
  resize();

  /** Ways to draw more coarsely, one after the other; a screen's own finer points go first. */
  const coarser = fine ? [] : [
    () => {
      key.shadow.mapSize.set(COARSE_SHADOWS, COARSE_SHADOWS);
      key.shadow.map?.dispose();
      key.shadow.map = null;
    },
    () => renderer.setPixelRatio(Math.min(1, renderer.getPixelRatio())),
    () => renderer.setPixelRatio(Math.min(0.75, renderer.getPixelRatio())),
    () => { key.castShadow = false; compiler.forget(); },
  ];
  if (!plain) reflect();

  /** Let bodies reflect a room. */
  function reflect() {
    const room = new THREE.PMREMGenerator(renderer);
    scene.environment = room.fromScene(new RoomEnvironment(), 0.04).texture;
    room.dispose();
  }

  function setTheme(theme) {
    element.style.background = theme.background;
    renderer.toneMappingExposure = theme.exposure;
    key.intensity = theme.key;
    fill.intensity = theme.fill + (plain ? INSTEAD_OF_ROOM * theme.surround : 0);
    scene.environmentIntensity = theme.surround;
    ground.setTheme(theme);
    invalidate();
  }

  /** Draw more coarsely where pictures take too long, as without a graphics processor. */
  function judge(milliseconds) {
    slow = milliseconds > SLOW_MS ? slow + 1 : Math.max(0, slow - 1);
    if (slow < STILL_SLOW_PICTURES || !coarser.length) return;
    slow = 0;
    coarser.shift()();
    invalidate();
  }

  return {
    scene, camera, controls, renderer, canvas, ground, invalidate, setTheme,
    size: () => [width, height],
    /** Whether the picture shows all that there is. */
    upToDate: () => !changed,

    /** Put the light so that all within a radius [m] of a centre has a shadow. */
    light(centre, radius) {
      const place = (light, x, y, z) => {
        light.position.set(centre.x + x * radius, centre.y + y * radius, centre.z + z * radius);
        light.target.position.copy(centre);
        light.target.updateMatrixWorld();
      };
      place(key, 1.5, -1.2, 3.0);
      place(rim, -2.0, 2.2, 1.2);
      const frame = key.shadow.camera;
      [frame.left, frame.right, frame.bottom, frame.top] = [-radius, radius, -radius, radius]
        .map((x) => 1.25 * x);
      [frame.near, frame.far] = [0.05, 8 * radius];
      frame.updateProjectionMatrix();
    },

    /** Draw at `now` [ms] if something has changed since, and it may; return whether it did. */
    draw(now) {
      controls.update();
      const took = pace.took(now);
      if (took !== null) judge(took);
      if (!changed || !pace.may(now) || !compiler.ready()) return false;
      changed = false;
      renderer.render(scene, camera);
      pace.begun(now);
      return true;
    },

    dispose() {
      observer.disconnect();
      controls.dispose();
      scene.traverse((object) => {
        object.geometry?.dispose();
        for (const material of [object.material].flat()) {
          material?.map?.dispose();
          material?.dispose?.();
        }
      });
      scene.environment?.dispose();
      renderer.dispose();
      canvas.remove();
    },
  };
}

/** Return the name of what this browser draws with. */
function rendererName() {
  const gl = document.createElement("canvas").getContext("webgl2");
  const unmasked = gl.getExtension("WEBGL_debug_renderer_info")?.UNMASKED_RENDERER_WEBGL;
  const name = String(gl.getParameter(unmasked ?? gl.RENDERER));
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}
