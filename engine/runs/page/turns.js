// Rotations as quaternions x, y, z, w and as matrices row by row, and interpolation in time. Arguments `out` are written and returned;
// `at`, `i` and `j` are offsets into arrays of quaternions.

/** Return the indices of the times before and after a time, and how far it is between them (0 to 1). @param {number[]} times @param {number} time */
function bracket(times, time) {
  let after = times.findIndex((each) => each > time);
  if (after === -1) after = times.length;
  if (after === 0 || after === times.length) {
    const end = after === 0 ? 0 : times.length - 1;
    return [end, end, 0];
  }
  return [after - 1, after, (time - times[after - 1]) / (times[after] - times[after - 1])];
}

/** Ease in and out from 0 to 1 (smoothstep). @param {number} x */
function smooth(x) {
  const t = Math.min(Math.max(x, 0), 1);
  return t * t * (3 - 2 * t);
}

/** Interpolate between two quaternions that are near each other (normalised lerp). */
function mixedTurn(one, i, two, j, share, out, at) {
  let same = 0;
  for (let k = 0; k < 4; k++) same += one[i + k] * two[j + k];
  const sign = same < 0 ? -share : share;
  let square = 0;
  for (let k = 0; k < 4; k++) {
    out[at + k] = (1 - share) * one[i + k] + sign * two[j + k];
    square += out[at + k] ** 2;
  }
  const scale = 1 / Math.sqrt(square);
  for (let k = 0; k < 4; k++) out[at + k] *= scale;
  return out;
}

/** Multiply quaternions: the rotation b, followed by a. */
function product(a, b, out, at) {
  out[at] = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1];
  out[at + 1] = a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0];
  out[at + 2] = a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3];
  out[at + 3] = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
  return out;
}

/** Compose the rotation by an angle about z, followed by a quaternion of an array. */
function aboutZ(turns, at, angle, out) {
  const sine = Math.sin(0.5 * angle);
  const cosine = Math.cos(0.5 * angle);
  out[0] = turns[at] * cosine + turns[at + 1] * sine;
  out[1] = turns[at + 1] * cosine - turns[at] * sine;
  out[2] = turns[at + 2] * cosine + turns[at + 3] * sine;
  out[3] = turns[at + 3] * cosine - turns[at + 2] * sine;
}

/** Compute the rotation from frame a to frame b, in the coordinates of a. */
function between(a, b, out) {
  out[0] = a[3] * b[0] - a[0] * b[3] - a[1] * b[2] + a[2] * b[1];
  out[1] = a[3] * b[1] + a[0] * b[2] - a[1] * b[3] - a[2] * b[0];
  out[2] = a[3] * b[2] - a[0] * b[1] + a[1] * b[0] - a[2] * b[3];
  out[3] = a[3] * b[3] + a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** Rotate a vector in place. */
function turned(turns, at, vector) {
  return turnedBy(turns[at], turns[at + 1], turns[at + 2], turns[at + 3], vector);
}

/** Rotate a vector in place by the inverse. */
function turnedBack(turns, at, vector) {
  return turnedBy(-turns[at], -turns[at + 1], -turns[at + 2], turns[at + 3], vector);
}

/** Rotate a vector in place by the quaternion x, y, z, w. */
function turnedBy(x, y, z, w, vector) {
  const [vx, vy, vz] = vector;
  const tx = 2 * (y * vz - z * vy);
  const ty = 2 * (z * vx - x * vz);
  const tz = 2 * (x * vy - y * vx);
  vector[0] = vx + w * tx + y * tz - z * ty;
  vector[1] = vy + w * ty + z * tx - x * tz;
  vector[2] = vz + w * tz + x * ty - y * tx;
  return vector;
}

/** Convert a quaternion to a rotation vector (radians). */
function rotationVector(q, out) {
  const sign = q[3] < 0 ? -1 : 1;
  const sine = Math.hypot(q[0], q[1], q[2]);
  const scale = sine > 1e-9 ? (2 * Math.atan2(sine, sign * q[3])) / sine : 2;
  for (let k = 0; k < 3; k++) out[k] = sign * scale * q[k];
  return out;
}

/** Convert a quaternion of an array to a matrix. */
function matrixOf(turns, at, out) {
  const [x, y, z, w] = [turns[at], turns[at + 1], turns[at + 2], turns[at + 3]];
  out[0] = 1 - 2 * (y * y + z * z);
  out[1] = 2 * (x * y - z * w);
  out[2] = 2 * (x * z + y * w);
  out[3] = 2 * (x * y + z * w);
  out[4] = 1 - 2 * (x * x + z * z);
  out[5] = 2 * (y * z - x * w);
  out[6] = 2 * (x * z - y * w);
  out[7] = 2 * (y * z + x * w);
  out[8] = 1 - 2 * (x * x + y * y);
}

/** Convert a rotation vector to a matrix (Rodrigues). */
function exponential(x, y, z, out) {
  const square = x * x + y * y + z * z;
  const angle = Math.sqrt(square);
  const sine = angle > 1e-4 ? Math.sin(angle) / angle : 1 - square / 6;
  const cosine = angle > 1e-4 ? (1 - Math.cos(angle)) / square : 0.5;
  const rest = 1 - cosine * square;
  out[0] = rest + cosine * x * x;
  out[1] = cosine * x * y - sine * z;
  out[2] = cosine * x * z + sine * y;
  out[3] = cosine * x * y + sine * z;
  out[4] = rest + cosine * y * y;
  out[5] = cosine * y * z - sine * x;
  out[6] = cosine * x * z - sine * y;
  out[7] = cosine * y * z + sine * x;
  out[8] = rest + cosine * z * z;
}
