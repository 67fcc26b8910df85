/** Poses as arrays `[x, y, z, qx, qy, qz, qw]`, and quaternions `[x, y, z, w]`; no library. */

/** Return the product of two quaternions. */
export function product(a, b) {
  return [
    a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1],
    a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0],
    a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3],
    a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2],
  ];
}

/** Return a vector turned by a quaternion. */
export function turned(q, v) {
  const x = 2 * (q[1] * v[2] - q[2] * v[1]);
  const y = 2 * (q[2] * v[0] - q[0] * v[2]);
  const z = 2 * (q[0] * v[1] - q[1] * v[0]);
  return [
    v[0] + q[3] * x + q[1] * z - q[2] * y,
    v[1] + q[3] * y + q[2] * x - q[0] * z,
    v[2] + q[3] * z + q[0] * y - q[1] * x,
  ];
}

/** Return the place of a point of frame b, where `T` is b's pose in a. */
export function placed(T, point) {
  const [x, y, z] = turned(attitude(T), point);
  return [x + T[0], y + T[1], z + T[2]];
}

/** Return `T_a_c` of `T_a_b` and `T_b_c`. */
export function composed(a, b) {
  return [...placed(a, b), ...product(attitude(a), attitude(b))];
}

/** Return the quaternion of a pose. */
export function attitude(T) {
  return [T[3], T[4], T[5], T[6]];
}

/** Return the pose of `[x, y, z, roll, pitch, yaw]`, about fixed axes. */
export function fromRpy([x, y, z, roll, pitch, yaw]) {
  const [a, b, c] = [Math.cos(roll / 2), Math.cos(pitch / 2), Math.cos(yaw / 2)];
  const [d, e, f] = [Math.sin(roll / 2), Math.sin(pitch / 2), Math.sin(yaw / 2)];
  return [
    x, y, z,
    d * b * c - a * e * f,
    a * e * c + d * b * f,
    a * b * f - d * e * c,
    a * b * c + d * e * f,
  ];
}

/** Return `[x, y, z, roll, pitch, yaw]` of a pose. */
export function toRpy(T) {
  const [x, y, z, w] = attitude(T);
  const sine = Math.min(1, Math.max(-1, 2 * (w * y - z * x)));
  if (Math.abs(sine) > 1 - 1e-12) {
    return [T[0], T[1], T[2], 0, (Math.sign(sine) * Math.PI) / 2,
      Math.atan2(2 * (w * z - x * y), 1 - 2 * (x * x + z * z))];
  }
  return [
    T[0], T[1], T[2],
    Math.atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y)),
    Math.asin(sine),
    Math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)),
  ];
}

/** Return the pose a part of the way from a to b: straight, and by the shorter turn. */
export function between(a, b, part) {
  let cosine = a[3] * b[3] + a[4] * b[4] + a[5] * b[5] + a[6] * b[6];
  const sign = cosine < 0 ? -1 : 1;
  cosine = Math.min(1, cosine * sign);
  const angle = Math.acos(cosine);
  const sine = Math.sin(angle);
  const [u, v] = sine < 1e-6
    ? [1 - part, part]
    : [Math.sin((1 - part) * angle) / sine, Math.sin(part * angle) / sine];
  const T = a.map((x, i) => (i < 3 ? x + part * (b[i] - x) : u * x + sign * v * b[i]));
  const length = Math.hypot(T[3], T[4], T[5], T[6]) || 1;
  for (let i = 3; i < 7; i += 1) T[i] /= length;
  return T;
}
