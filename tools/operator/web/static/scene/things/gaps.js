/** Nearest gaps: a line between the nearest points, from grey to red as it gets to what it keeps. */

import { THREE, lay } from "../stage/kit.js";
import { capsulesAt } from "../geometry/kinematics.js";
import { between, segmentBox, segments } from "../geometry/nearest.js";
import { placed, turned } from "../geometry/poses.js";

const MOST = 6;
/** Gaps of more than this times what they keep, and of the distance that counts as near, are grey. */
const FAR = 3;

export function createGaps(description, materials, labels) {
  const object = new THREE.Group();
  const rod = new THREE.CylinderGeometry(1, 1, 1, 10).rotateX(Math.PI / 2).translate(0, 0, 0.5);
  const ball = new THREE.SphereGeometry(1, 12, 8);
  const pool = Array.from({ length: MOST }, (_, i) => {
    const material = new THREE.MeshBasicMaterial({
      transparent: true, depthTest: false, toneMapped: false,
    });
    const group = new THREE.Group();
    const parts = [rod, ball, ball].map((geometry) => new THREE.Mesh(geometry, material));
    for (const part of parts) part.renderOrder = 20;
    group.add(...parts);
    group.visible = false;
    object.add(group);
    return { group, material, parts, label: labels.add("", { rank: 6 - 0.1 * i }) };
  });
  const [calm, alert] = [new THREE.Color(), new THREE.Color()];
  const { clearance, self_clearance: own, near } = description.avoidance;

  return {
    object,
    setTheme(theme) {
      calm.set(theme.gap);
      alert.set(theme.danger);
    },
    pose(view, obstacles) {
      const capsules = view.state?.gaps?.length
        ? capsulesAt(description, view.commanded, placed) : [];
      pool.forEach((line, i) => {
        const gap = view.state?.gaps?.[i];
        const found = gap && points(gap, capsules, obstacles);
        const keep = gap && (obstacles.get(gap[1])?.told.clearance ?? (obstacles.has(gap[1]) ? clearance : own));
        line.group.visible = Boolean(found) && found.distance < Math.max(near, FAR * keep);
        if (!line.group.visible) return line.label.at(null);
        return draw(line, gap, found, keep);
      });
    },
  };

  function draw({ group, material, parts, label }, [, , distance, active], { from, to }, keep) {
    const far = Math.max(near, FAR * keep);
    const alarm = active ? 1 : Math.min(1, Math.max(0, (far - distance) / (far - keep + 1e-9))) ** 2;
    material.color.copy(calm).lerp(alert, alarm);
    material.opacity = 0.55 + 0.45 * alarm;
    const thick = 0.0016 + 0.0016 * alarm;
    const length = lay(parts[0], from, to);
    parts[0].scale.set(thick, thick, Math.max(length, 1e-6));
    [from, to].forEach((p, i) => {
      parts[i + 1].position.set(...p);
      parts[i + 1].scale.setScalar(2.6 * thick);
    });
    group.visible = true;
    label.setRole(active || distance < 1.25 * keep ? "danger" : null);
    label.at(
      from.map((x, i) => 0.5 * (x + to[i])),
      `${(1000 * distance).toFixed(0)} mm ≥ ${(1000 * keep).toFixed(0)}`,
    );
  }
}

/** Return the nearest points of a told pair; null where its shapes are not known. */
function points([link, other], capsules, obstacles) {
  const mine = capsules.filter((capsule) => capsule.of === link);
  const against = obstacles.get(other);
  let best = null;
  const judge = (pair, a, b) => {
    const found = between(...pair, a, b);
    if (!best || found.distance < best.distance) best = found;
  };
  for (const { start, end, radius } of mine) {
    if (!against) {
      for (const their of capsules.filter((capsule) => capsule.of === other)) {
        judge(segments(start, end, their.start, their.end), radius, their.radius);
      }
      continue;
    }
    const { told } = against;
    if (told.shape === "box") {
      const inverse = [-against.pose[3], -against.pose[4], -against.pose[5], against.pose[6]];
      const local = (p) => turned(inverse, p.map((x, i) => x - against.pose[i]));
      const pair = segmentBox(local(start), local(end), told.half_size);
      judge(pair.map((p) => placed(against.pose, p)), radius, 0);
    } else {
      const a = against.from ?? told.xyz;
      judge(segments(start, end, a, told.to ?? a), radius, told.radius);
    }
  }
  return best;
}

