/** Points that a laser scanner has seen: those of its last scans, in World. */

import { THREE } from "../stage/kit.js";

/** Older points make room for new ones: two sweeps of a scanner of half a thousand rays. */
const MOST = 60000;
const SIZE_PX = 1.6;

/** Return the coordinates of a scan's points, one after the other [m]; told in base 64 [mm]. */
export function pointsOf(points_mm) {
  const bytes = Uint8Array.from(atob(points_mm), (c) => c.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Float32Array.from({ length: 3 * Math.floor(bytes.length / 12) },
    (_, i) => view.getInt32(4 * i, true) / 1000);
}

export function createScan(materials) {
  const places = new Float32Array(3 * MOST);
  const geometry = new THREE.BufferGeometry();
  const attribute = new THREE.BufferAttribute(places, 3).setUsage(THREE.DynamicDrawUsage);
  geometry.setAttribute("position", attribute);
  geometry.setDrawRange(0, 0);
  const material = materials.material("scan", () => new THREE.PointsMaterial({
    size: SIZE_PX, sizeAttenuation: false, toneMapped: false,
  }), (theme) => theme.scan);
  const object = new THREE.Points(geometry, material);
  object.frustumCulled = false;
  let next = 0;
  let count = 0;
  return {
    object,
    /** Take in the points of one more scan. */
    news(scan) {
      for (const x of pointsOf(scan.points_mm)) {
        places[next] = x;
        next = (next + 1) % places.length;
        count = Math.min(places.length, count + 1);
      }
      geometry.setDrawRange(0, count / 3);
      attribute.needsUpdate = true;
    },
    pose() {},
  };
}
