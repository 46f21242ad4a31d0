// The picture of the space: floor, points, lines and the mechanism on a canvas.

import { framesOf, movePoint, roundStep } from "./scene_space.mjs";
import { formatNumber, shadesBetween } from "./scene_cloud.mjs";

const LABEL_FONT = "600 13px system-ui, sans-serif";
const MANY = 1500; // from so many points on they are drawn as squares

/** @param {Element} element @returns {object} the colours of the page, which follow the reader's preference */
export function coloursOf(element) {
  const style = getComputedStyle(element);
  const pick = (name) => style.getPropertyValue(`--scene-${name}`).trim();
  const names = ["ink", "soft", "line", "body", "pivot", "edge", "axis", "mark", "faded", "ground"];
  const colours = Object.fromEntries(names.map((name) => [name, pick(name)]));
  return { ...colours, shades: shadesBetween(pick("scale")) };
}

/** @param {number} x @param {number} y @param {number[]} a @param {number[]} b @returns {number} squared, in pixels */
function squareToLine(x, y, [ax, ay], [bx, by]) {
  const [dx, dy] = [bx - ax, by - ay];
  const along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1);
  const share = Math.max(0, Math.min(1, along));
  return (ax + share * dx - x) ** 2 + (ay + share * dy - y) ** 2;
}

/** Draws a scene on a canvas as its camera sees it. */
export class Painter {
  /** @param {HTMLCanvasElement} canvas @param {object} scene with camera, cloud, mechanism, values, lines, bounds */
  constructor(canvas, scene) {
    this.canvas = canvas;
    this.scene = scene;
    this.pen = canvas.getContext("2d");
  }

  /** Draw everything anew. */
  paint() {
    const { pen, scene, canvas } = this;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    pen.lineCap = "round";
    pen.lineJoin = "round";
    scene.camera.fit(width, height);
    this.colours = coloursOf(canvas);
    this.labels = [];
    this.paintFloor();
    scene.lines.forEach((line) => this.stroke(line.at, this.colours.soft, 1.5));
    if (scene.mechanism) this.paintMechanism();
    if (scene.cloud) this.paintCloud();
    this.labels.forEach((one) => this.write(one));
    this.paintAxes();
  }

  /** @param {number[][]} points @param {string} colour @param {number} width @param {number[]} dash */
  stroke(points, colour, width, dash = []) {
    const { pen, scene } = this;
    pen.beginPath();
    points.forEach((point, i) => {
      const [x, y] = scene.camera.project(...point);
      if (i) pen.lineTo(x, y);
      else pen.moveTo(x, y);
    });
    pen.setLineDash(dash);
    pen.strokeStyle = colour;
    pen.lineWidth = width;
    pen.stroke();
    pen.setLineDash([]);
  }

  /**
   * A label near a point, where none is yet.
   * @param {string} text
   * @param {number[]} point
   * @param {string} colour
   * @param {number} [away] pixels, from a point that must stay visible
   */
  label(text, point, colour, away = 0) {
    const { pen, scene } = this;
    const [x, y] = scene.camera.project(...point);
    pen.font = LABEL_FONT;
    const half = pen.measureText(text).width / 2 + 3;
    const free = [
      [0, -away],
      [0, -17 - away],
      [0, 17 + away],
      [half + 14, 0],
      [-half - 14, 0],
    ].find(([dx, dy]) =>
      this.labels.every((other) => Math.abs(other.x - x - dx) > other.half + half || Math.abs(other.y - y - dy) > 16),
    );
    if (!free) return;
    this.labels.push({ text, colour, x: x + free[0], y: y + free[1], half });
  }

  /** @param {{text: string, colour: string, x: number, y: number}} label above all that is drawn */
  write({ text, colour, x, y }) {
    const { pen } = this;
    pen.font = LABEL_FONT;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.lineWidth = 4;
    pen.strokeStyle = this.colours.ground;
    pen.strokeText(text, x, y);
    pen.fillStyle = colour;
    pen.fillText(text, x, y);
  }

  /** A grid on the floor, by which lengths can be read. */
  paintFloor() {
    const { low, middle, radius } = this.scene.bounds;
    const step = roundStep(radius / 2.5);
    const reach = 1.05 * radius;
    const ends = [0, 1].map((k) => [
      Math.floor((middle[k] - reach) / step) * step,
      Math.ceil((middle[k] + reach) / step) * step,
    ]);
    const [[x0, x1], [y0, y1]] = ends;
    for (let x = x0; x <= x1 + step / 2; x += step)
      this.stroke(
        [
          [x, y0, low[2]],
          [x, y1, low[2]],
        ],
        this.colours.line,
        1,
      );
    for (let y = y0; y <= y1 + step / 2; y += step)
      this.stroke(
        [
          [x0, y, low[2]],
          [x1, y, low[2]],
        ],
        this.colours.line,
        1,
      );
    this.gridStep = step;
  }

  /** The directions of x, y and z in a corner, and the width of the grid. */
  paintAxes() {
    const { pen, scene, colours } = this;
    const [x, y] = [46, scene.camera.height - 46];
    const { right, up } = scene.camera;
    pen.font = LABEL_FONT;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    ["x", "y", "z"].forEach((name, k) => {
      const [dx, dy] = [right[k], -up[k]];
      pen.beginPath();
      pen.moveTo(x, y);
      pen.lineTo(x + 24 * dx, y + 24 * dy);
      pen.strokeStyle = colours.axis;
      pen.lineWidth = 2;
      pen.stroke();
      pen.fillStyle = colours.ink;
      pen.fillText(name, x + 34 * dx, y + 34 * dy);
    });
    pen.textAlign = "right";
    pen.fillStyle = colours.soft;
    const grid = `grid ${formatNumber(this.gridStep, 1)} ${scene.unit}`;
    pen.fillText(grid, scene.camera.width - 12, scene.camera.height - 16);
  }

  /** Points, those outside the selection faint and below. Where they are on the canvas is kept for the pointer. */
  paintCloud() {
    const { pen, scene, colours } = this;
    const { cloud, camera } = scene;
    const n = cloud.count;
    this.flat = this.flat && this.flat.length === 2 * n ? this.flat : new Float32Array(2 * n);
    for (let i = 0; i < n; i += 1) {
      const [x, y] = camera.project(cloud.at[0][i], cloud.at[1][i], cloud.at[2][i]);
      this.flat[2 * i] = x;
      this.flat[2 * i + 1] = y;
    }
    const size = Math.max(2.5, Math.min(9, (180 / Math.sqrt(n)) * Math.min(1.6, camera.zoom ** 0.4)));
    this.paintSpans(size);
    pen.fillStyle = colours.faded;
    if (cloud.ranges.size) for (const i of cloud.order) if (!cloud.selected[i]) this.dot(i, 0.7 * size);
    let shade = -1;
    for (const i of cloud.order) {
      if (!cloud.selected[i]) continue;
      if (cloud.shade[i] !== shade) {
        shade = cloud.shade[i];
        pen.fillStyle = colours.shades[shade];
      }
      this.dot(i, size);
    }
    cloud.marked.forEach((text, i) => {
      this.ring(i, size, colours.ink);
      const [x, y, z] = cloud.at.map((column) => column[i]);
      this.label(text, [x, y, z], colours.ink, size / 2 + 14);
    });
    if (scene.current >= 0) this.ring(scene.current, size, colours.mark);
  }

  /** @param {number} size of a point: the lines of points that stand for something between two ends */
  paintSpans(size) {
    const { cloud, camera } = this.scene;
    const { shades, faded } = this.colours;
    this.flatSpans = new Map();
    const order = [...cloud.order].filter((i) => cloud.spans.has(i));
    [0, 1].forEach((selected) =>
      order
        .filter((i) => cloud.selected[i] === selected)
        .forEach((i) => {
          const ends = cloud.spans.get(i);
          this.flatSpans.set(
            i,
            ends.map((end) => camera.project(...end)),
          );
          this.stroke(ends, selected ? shades[cloud.shade[i]] : faded, 0.45 * size);
        }),
    );
  }

  /** @param {number} i @param {number} size */
  dot(i, size) {
    const [x, y] = [this.flat[2 * i], this.flat[2 * i + 1]];
    if (this.scene.cloud.count > MANY) {
      this.pen.fillRect(x - size / 2, y - size / 2, size, size);
      return;
    }
    this.pen.beginPath();
    this.pen.arc(x, y, size / 2, 0, 2 * Math.PI);
    this.pen.fill();
  }

  /** @param {number} i @param {number} size @param {string} ink */
  ring(i, size, ink) {
    const { pen, colours } = this;
    [
      [colours.ground, 5],
      [ink, 2.5],
    ].forEach(([colour, width]) => {
      pen.beginPath();
      pen.arc(this.flat[2 * i], this.flat[2 * i + 1], size / 2 + 4, 0, 2 * Math.PI);
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.stroke();
    });
  }

  /**
   * @param {number} x
   * @param {number} y
   * @param {number} within so many pixels
   * @returns {number} the selected point there, else that of the nearest line, or -1
   */
  pointAt(x, y, within) {
    const { cloud } = this.scene;
    if (!cloud || !this.flat) return -1;
    let [best, least] = [-1, within * within];
    for (const i of cloud.order) {
      const distance = (this.flat[2 * i] - x) ** 2 + (this.flat[2 * i + 1] - y) ** 2;
      if (distance <= least && cloud.selected[i]) [best, least] = [i, distance];
    }
    if (best >= 0) return best;
    this.flatSpans.forEach((ends, i) => {
      const distance = squareToLine(x, y, ...ends);
      if (distance <= least && cloud.selected[i]) [best, least] = [i, distance];
    });
    return best;
  }

  /** The mechanism: its links and pivots far to near, then its axes, its end, the lengths of its straight pieces. */
  paintMechanism() {
    const { scene, colours } = this;
    const { mechanism, camera } = scene;
    const frames = framesOf(mechanism, scene.values);
    const thick = Math.max(3, Math.min(30, 0.3 * mechanism.size * camera.pixels()));
    if (scene.ghost) this.paintGhost(framesOf(mechanism, scene.ghost), thick);
    [...this.linkPieces(frames), ...this.pivotPieces(frames)]
      .sort((a, b) => this.nearness(a) - this.nearness(b))
      .forEach(({ at, width, cap, colour }) => {
        this.pen.lineCap = cap;
        this.stroke(at, colours.edge, thick * width + 2);
        this.stroke(at, colour, thick * width);
      });
    this.pen.lineCap = "round";
    frames.before.forEach((frame, i) => this.paintAxis(frame, i));
    this.stroke([frames.end, frames.end], colours.ground, Math.max(12, 0.45 * thick));
    this.stroke([frames.end, frames.end], colours.mark, Math.max(8, 0.35 * thick));
    this.label(mechanism.endName, frames.end, colours.ink);
    frames.before.forEach((frame, i) =>
      this.label(mechanism.names[i], movePoint(frame, [0, 0, 1.35 * mechanism.size]), colours.ink),
    );
    if (scene.showLengths) this.writeLengths(frames);
  }

  /** @param {object} frames of the same parts elsewhere @param {number} thick its links, translucent */
  paintGhost(frames, thick) {
    this.pen.globalAlpha = 0.35;
    this.linkPieces(frames).forEach(({ at, width }) => this.stroke(at, this.colours.axis, thick * width));
    this.pen.globalAlpha = 1;
  }

  /** @param {{at: number[][]}} piece @returns {number} */
  nearness({ at }) {
    return this.scene.camera.project(...at[0])[2] + this.scene.camera.project(...at[1])[2];
  }

  /** @param {object} frames @returns {object[]} the straight pieces of all links, in space */
  linkPieces(frames) {
    const { links } = this.scene.mechanism;
    const places = [null, ...frames.after];
    return links.flatMap((link, i) => {
      const path = places[i] ? link.map((point) => movePoint(places[i], point)) : link;
      const width = i === 0 ? 1.2 : i === links.length - 1 ? 0.4 : 0.9;
      return path.slice(1).map((end, k) => ({ at: [path[k], end], width, cap: "round", colour: this.colours.body }));
    });
  }

  /** @param {object} frames @returns {object[]} a short thick piece along the axis of each pivot */
  pivotPieces(frames) {
    const half = 0.19 * this.scene.mechanism.size;
    return frames.before.map((frame) => ({
      at: [movePoint(frame, [0, 0, -half]), movePoint(frame, [0, 0, half])],
      width: 1.25,
      cap: "butt",
      colour: this.colours.pivot,
    }));
  }

  /** @param {number[]} frame @param {number} i the axis of a pivot, and an arrow in its positive direction */
  paintAxis(frame, i) {
    const { colours } = this;
    const { size, slides } = this.scene.mechanism;
    const along = (way) => movePoint(frame, [0, 0, way * size]);
    this.stroke([along(-0.7), along(1.2)], colours.axis, 1.2, [8, 3, 2, 3]);
    if (slides[i]) {
      this.arrowHead(along(0.9), along(1.2));
      return;
    }
    const turn = (angle) => movePoint(frame, [0.2 * size * Math.cos(angle), 0.2 * size * Math.sin(angle), 0.95 * size]);
    const arc = Array.from({ length: 25 }, (_, k) => turn(0.3 + (k / 24) * 1.5 * Math.PI));
    this.stroke(arc, colours.axis, 1.5);
    this.arrowHead(arc[20], arc[24]);
  }

  /** @param {number[]} from @param {number[]} to */
  arrowHead(from, to) {
    const { pen, scene, colours } = this;
    const [x0, y0] = scene.camera.project(...from);
    const [x, y] = scene.camera.project(...to);
    const angle = Math.atan2(y - y0, x - x0);
    pen.beginPath();
    pen.moveTo(x + 3 * Math.cos(angle), y + 3 * Math.sin(angle));
    [2.5, -2.5].forEach((side) => pen.lineTo(x + 8 * Math.cos(angle + side), y + 8 * Math.sin(angle + side)));
    pen.fillStyle = colours.axis;
    pen.fill();
  }

  /** @param {object} frames the longest first: where labels meet, the short pieces have none */
  writeLengths(frames) {
    this.linkPieces(frames)
      .map(({ at: [a, b] }) => ({ length: Math.hypot(...a.map((value, k) => value - b[k])), a, b }))
      .filter(({ length }) => length > 0.25 * this.scene.mechanism.size)
      .sort((one, other) => other.length - one.length)
      .forEach(({ length, a, b }) => {
        const middle = a.map((value, k) => (value + b[k]) / 2);
        this.label(`${Math.round(length * 10) / 10}`, middle, this.colours.soft);
      });
  }
}
