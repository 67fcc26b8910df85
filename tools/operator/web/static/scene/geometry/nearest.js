/** Nearest points of capsules, boxes and spheres, to draw a gap that State only tells the size of. */

const sub = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const at = (a, d, t) => [a[0] + t * d[0], a[1] + t * d[1], a[2] + t * d[2]];
const clamp = (x) => Math.min(1, Math.max(0, x));

/** Return the nearest points of two segments, as `[on the first, on the second]` (Ericson 2005). */
export function segments(a, b, c, d) {
  const u = sub(b, a);
  const v = sub(d, c);
  const r = sub(a, c);
  const [uu, vv, uv, ur, vr] = [dot(u, u), dot(v, v), dot(u, v), dot(u, r), dot(v, r)];
  let s = 0;
  let t = 0;
  if (uu > 1e-12 && vv > 1e-12) {
    const denominator = uu * vv - uv * uv;
    s = denominator > 1e-12 * uu * vv ? clamp((uv * vr - ur * vv) / denominator) : 0;
    t = (uv * s + vr) / vv;
    if (t < 0) [t, s] = [0, clamp(-ur / uu)];
    else if (t > 1) [t, s] = [1, clamp((uv - ur) / uu)];
  } else if (uu > 1e-12) {
    s = clamp(-ur / uu);
  } else if (vv > 1e-12) {
    t = clamp(vr / vv);
  }
  return [at(a, u, s), at(c, v, t)];
}

/** Return the nearest points of a segment and a box at the origin of its own axes. */
export function segmentBox(a, b, half) {
  const d = sub(b, a);
  const onBox = (p) => p.map((x, i) => Math.min(half[i], Math.max(-half[i], x)));
  // The distance is convex along the segment: its slope changes its sign once.
  const slope = (t) => {
    const p = at(a, d, t);
    return dot(sub(p, onBox(p)), d);
  };
  let [low, high] = [0, 1];
  if (slope(0) >= 0) high = 0;
  else if (slope(1) <= 0) low = 1;
  for (let i = 0; i < 40 && high > low; i += 1) {
    const middle = 0.5 * (low + high);
    if (slope(middle) > 0) high = middle;
    else low = middle;
  }
  const p = at(a, d, 0.5 * (low + high));
  return [p, onBox(p)];
}

/** Return two points moved towards each other by the radii around them. */
export function between(p, q, radiusP, radiusQ) {
  const way = sub(q, p);
  const length = Math.sqrt(dot(way, way));
  if (length < 1e-9) return { from: p, to: q, distance: -radiusP - radiusQ };
  return {
    from: at(p, way, radiusP / length),
    to: at(q, way, -radiusQ / length),
    distance: length - radiusP - radiusQ,
  };
}
