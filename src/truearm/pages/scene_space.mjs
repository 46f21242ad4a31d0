// Rigid motions, the mechanism's frames, and the camera. No drawing, no document: these functions run anywhere.

/** @typedef {number[]} Vector three numbers */
/** @typedef {number[]} Motion twelve numbers: three rows of a rotation, each with its translation */

const RAD_PER_DEG = Math.PI / 180;
const FULL = 0.9; // share of the picture that a scene fills which moves by itself
const EYE_DISTANCE = 4; // in radii of the scene: a mild perspective

/** @param {Motion} a @param {Motion} b @returns {Motion} a, then b in the frame of a */
export function composeMotions(a, b) {
  const out = new Array(12);
  for (let row = 0; row < 12; row += 4) {
    for (let column = 0; column < 4; column += 1) {
      out[row + column] = a[row] * b[column] + a[row + 1] * b[4 + column] + a[row + 2] * b[8 + column];
    }
    out[row + 3] += a[row + 3];
  }
  return out;
}

/** @param {Motion} motion @param {Vector} point @returns {Vector} the point moved */
export function movePoint(motion, [x, y, z]) {
  return [0, 4, 8].map((row) => motion[row] * x + motion[row + 1] * y + motion[row + 2] * z + motion[row + 3]);
}

/**
 * The motion of one pivot about, or along, its own z axis.
 * @param {number} value degrees, or a length where it slides
 * @param {boolean} slides
 * @returns {Motion}
 */
export function pivotMotion(value, slides) {
  if (slides) return [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, value];
  const cos = Math.cos(value * RAD_PER_DEG);
  const sin = Math.sin(value * RAD_PER_DEG);
  return [cos, -sin, 0, 0, sin, cos, 0, 0, 0, 0, 1, 0];
}

/**
 * The frames of a mechanism: right before each pivot, right after it, and after the last fixed motion.
 * @param {{fixed: Motion[], slides: boolean[], end: Vector}} mechanism
 * @param {number[]} values one a pivot
 * @returns {{before: Motion[], after: Motion[], last: Motion, end: Vector}}
 */
export function framesOf(mechanism, values) {
  const before = [];
  const after = [];
  let frame = mechanism.fixed[0];
  values.forEach((value, i) => {
    before.push(frame);
    after.push(composeMotions(frame, pivotMotion(value, mechanism.slides[i])));
    frame = composeMotions(after[i], mechanism.fixed[i + 1]);
  });
  return { before, after, last: frame, end: movePoint(frame, mechanism.end) };
}

/** @param {Motion} motion @returns {Vector} rotations about the fixed axes x, y, z, in this order [deg] */
export function rollPitchYaw(motion) {
  const pitch = Math.atan2(-motion[8], Math.hypot(motion[0], motion[4]));
  const level = Math.hypot(motion[0], motion[4]) < 1e-9;
  const roll = level ? 0 : Math.atan2(motion[9], motion[10]);
  const yaw = level ? Math.atan2(-motion[1], motion[5]) : Math.atan2(motion[4], motion[0]);
  return [roll, pitch, yaw].map((angle) => angle / RAD_PER_DEG);
}

/** @param {Vector[]} points @returns {{middle: Vector, radius: number, low: Vector}} the sphere around their box */
export function boundsOf(points) {
  const low = [0, 1, 2].map((k) => points.reduce((least, point) => Math.min(least, point[k]), Infinity));
  const high = [0, 1, 2].map((k) => points.reduce((most, point) => Math.max(most, point[k]), -Infinity));
  const middle = low.map((value, k) => (value + high[k]) / 2);
  return { middle, low, radius: Math.max(Math.hypot(...high.map((value, k) => value - low[k])) / 2, 1e-6) };
}

/** A camera that turns about a point; z is up. */
export class Camera {
  /** @param {{middle: Vector, radius: number}} bounds */
  constructor({ middle, radius }) {
    this.home = middle;
    this.radius = radius;
    this.reset();
  }

  /** Back to the first view. */
  reset() {
    this.target = [...this.home];
    this.zoom = 1;
    this.isChosen = false; // by a reader
    this.seen = [];
    this.look(-125, 20);
  }

  /** @param {number} azimuth of the eye, from x towards y [deg] @param {number} elevation [deg] */
  look(azimuth, elevation) {
    this.azimuth = azimuth;
    this.elevation = Math.max(-90, Math.min(90, elevation));
    const [a, e] = [this.azimuth * RAD_PER_DEG, this.elevation * RAD_PER_DEG];
    this.right = [-Math.sin(a), Math.cos(a), 0];
    this.up = [-Math.sin(e) * Math.cos(a), -Math.sin(e) * Math.sin(a), Math.cos(e)];
    this.near = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
  }

  /** @param {number} across @param {number} up turn by so many degrees */
  turn(across, up) {
    this.look(this.azimuth + across, this.elevation + up);
  }

  /**
   * @param {number} factor above 1: nearer
   * @param {number} [x] what is there in the picture stays there; its middle by default
   * @param {number} [y]
   */
  magnify(factor, x = this.width / 2, y = this.height / 2) {
    const before = this.zoom;
    this.zoom = Math.max(0.2, Math.min(60, before * factor));
    const away = 1 - this.zoom / before;
    if (this.width) this.pan(away * (x - this.width / 2), away * (this.height / 2 - y));
  }

  /** So near that a part of the scene fills the picture. @param {{middle: Vector, radius: number}} part */
  approach({ middle, radius }) {
    this.target = [...middle];
    this.zoom = Math.max(1, Math.min(60, (0.8 * this.radius) / radius));
  }

  /**
   * Such that points fill the picture with all those of before, unless a reader chose another view.
   * @param {Vector[]} points
   * @returns {boolean} whether the view is another one now
   */
  include(points) {
    if (!this.width || this.isChosen || this.shareOf(points) <= 1) return false;
    this.seen.push(...points);
    this.target = boundsOf(this.seen).middle;
    for (let round = 0; round < 3; round += 1) this.zoom *= FULL / this.shareOf(this.seen); // of a perspective
    return true;
  }

  /** @param {Vector[]} points @returns {number} 1: they reach to the edge of the picture */
  shareOf(points) {
    const [x, y] = [this.width / 2, this.height / 2];
    const shares = points.map((point) => {
      const [right, down] = this.project(...point);
      return Math.max(Math.abs(right - x) / x, Math.abs(down - y) / y);
    });
    return Math.max(...shares);
  }

  /** @param {number} across @param {number} up shift the picture by so many pixels */
  pan(across, up) {
    const scale = this.pixels();
    this.isChosen = true;
    this.target = this.target.map((value, k) => value - (across * this.right[k] + up * this.up[k]) / scale);
  }

  /** @param {number} width @param {number} height of the picture in pixels */
  fit(width, height) {
    this.width = width;
    this.height = height;
  }

  /** @returns {number} pixels a unit of length at the target */
  pixels() {
    return (0.46 * Math.min(this.width, this.height * 1.25) * this.zoom) / this.radius;
  }

  /** @param {number} x @param {number} y @param {number} z @returns {Vector} right and down in pixels, and nearness */
  project(x, y, z) {
    const [dx, dy, dz] = [x - this.target[0], y - this.target[1], z - this.target[2]];
    const nearness = dx * this.near[0] + dy * this.near[1] + dz * this.near[2];
    const eye = EYE_DISTANCE * this.radius;
    const scale = (this.pixels() * eye) / Math.max(eye - nearness, 0.05 * eye);
    return [
      this.width / 2 + scale * (dx * this.right[0] + dy * this.right[1]),
      this.height / 2 - scale * (dx * this.up[0] + dy * this.up[1] + dz * this.up[2]),
      nearness,
    ];
  }
}

/** @param {number} about @returns {number} 1, 2 or 5 times a power of ten, at most `about` */
export function roundStep(about) {
  const power = 10 ** Math.floor(Math.log10(about));
  return [5, 2, 1].find((step) => step * power <= about * 1.0001) * power;
}
