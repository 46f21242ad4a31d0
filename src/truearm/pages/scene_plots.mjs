// Plots beside the space: values against each quantity, and how often each value occurs. A range selects points.

import { formatFixed } from "./scene_cloud.mjs";
import { coloursOf } from "./scene_paint.mjs";

const BINS = 40;
const EDGE = { left: 8, right: 8, top: 6, bottom: 20 };

/** One plot with a range that a reader draws, or moves with the keys. */
export class RangePlot {
  /**
   * @param {object} cloud
   * @param {number} axis which of its columns; -1: the histogram of the value
   * @param {() => void} changed called after another range was chosen
   */
  constructor(cloud, axis, changed) {
    this.cloud = cloud;
    this.axis = axis;
    this.changed = changed;
    this.element = document.createElement("div");
    this.element.className = "range-plot";
    this.title = document.createElement("span");
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "application");
    this.element.append(this.title, this.canvas);
    this.listen();
  }

  /** @returns {[number, number]} ends of the scale */
  ends() {
    if (this.axis < 0) return [0, this.cloud.value.top];
    const { low, high } = this.cloud.column(this.axis);
    return [low, high];
  }

  listen() {
    const { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.start = this.valueAt(event.offsetX);
      this.dragged = false;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.start === undefined || !canvas.hasPointerCapture(event.pointerId)) return;
      const end = this.valueAt(event.offsetX);
      this.dragged = true;
      this.limit([Math.min(this.start, end), Math.max(this.start, end)]);
    });
    canvas.addEventListener("pointerup", () => {
      if (!this.dragged) this.limit(null);
      this.start = undefined;
    });
    canvas.addEventListener("keydown", (event) => this.press(event));
  }

  /** @param {KeyboardEvent} event arrows move the range, with shift its upper end; escape clears it */
  press(event) {
    const way = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    if (event.key === "Escape") this.limit(null);
    else if (way) this.shift(way, event.shiftKey);
    else return;
    event.preventDefault();
  }

  /** @param {number} way @param {boolean} widen */
  shift(way, widen) {
    const [first, last] = this.ends();
    const span = last - first;
    const [low, high] = this.cloud.ranges.get(this.axis) ?? [first + 0.4 * span, first + 0.6 * span];
    const step = (way * span) / 20;
    const bounded = (value) => Math.max(first, Math.min(last, value));
    this.limit(widen ? [low, Math.max(low, bounded(high + step))] : [bounded(low + step), bounded(high + step)]);
  }

  /** @param {[number, number] | null} range a range up to the end of the scale includes what lies beyond */
  limit(range) {
    const last = this.ends()[1];
    const open = range && this.axis < 0 && range[1] >= last * 0.999;
    this.cloud.limit(this.axis, open ? [range[0], Infinity] : range);
    this.changed();
  }

  /** @param {number} x in pixels @returns {number} */
  valueAt(x) {
    const [low, high] = this.ends();
    const share = (x - EDGE.left) / Math.max(this.canvas.clientWidth - EDGE.left - EDGE.right, 1);
    return low + Math.max(0, Math.min(1, share)) * (high - low);
  }

  /** @param {number} value @returns {number} in pixels */
  xOf(value) {
    const [low, high] = this.ends();
    const share = Math.max(0, Math.min(1, (value - low) / (high - low)));
    return EDGE.left + share * (this.canvas.clientWidth - EDGE.left - EDGE.right);
  }

  /** Draw it anew. */
  paint() {
    const { canvas, cloud } = this;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (!width || !height) return;
    const ratio = window.devicePixelRatio || 1;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    this.pen = canvas.getContext("2d");
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.colours = coloursOf(canvas);
    const column = cloud.column(this.axis);
    const against = this.axis < 0 ? "how often" : `${cloud.value.name} against`;
    this.title.textContent = `${column.name} [${column.unit}]`;
    canvas.setAttribute(
      "aria-label",
      `${against} ${column.name} [${column.unit}]. Drag to select a range; arrow keys move it, shift and arrows ` +
        "widen it, escape clears it.",
    );
    this.paintRange(height);
    if (this.axis < 0) this.paintHistogram(height);
    else this.paintDots(height);
    this.paintScale(width, height);
  }

  /** @param {number} height */
  paintRange(height) {
    const range = this.cloud.ranges.get(this.axis);
    if (!range) return;
    const [x0, x1] = range.map((value) => this.xOf(value));
    this.pen.fillStyle = this.colours.line;
    this.pen.fillRect(x0, 0, Math.max(x1 - x0, 1), height - EDGE.bottom);
  }

  /** @param {number} height */
  paintHistogram(height) {
    const { cloud, pen, colours } = this;
    const { data, top } = cloud.value;
    const counts = new Array(BINS).fill(0);
    for (let i = 0; i < cloud.count; i += 1) counts[Math.min(BINS - 1, Math.floor((BINS * data[i]) / top))] += 1;
    const largest = Math.max(...counts);
    const width = (this.xOf(top) - this.xOf(0)) / BINS;
    counts.forEach((count, k) => {
      const full = count ? Math.max(2, ((height - EDGE.bottom - EDGE.top) * count) / largest) : 0;
      pen.fillStyle = colours.shades[Math.floor(((k + 0.5) / BINS) * colours.shades.length)];
      pen.fillRect(this.xOf(0) + k * width, height - EDGE.bottom - full, width - 1, full);
    });
    // A bar of all colours below, also where nothing occurs.
    colours.shades.forEach((shade, k) => {
      pen.fillStyle = shade;
      const step = (this.xOf(top) - this.xOf(0)) / colours.shades.length;
      pen.fillRect(this.xOf(0) + k * step, height - EDGE.bottom, step + 0.5, 4);
    });
  }

  /** @param {number} height */
  paintDots(height) {
    const { cloud, pen, colours } = this;
    const { data, top } = cloud.value;
    const column = cloud.column(this.axis);
    const size = Math.max(1.5, Math.min(4, 90 / Math.sqrt(cloud.count)));
    const y = (i) => height - EDGE.bottom - (height - EDGE.bottom - EDGE.top) * Math.min(1, data[i] / top);
    let shade = -1;
    for (const i of cloud.order) {
      const one = cloud.selected[i] ? cloud.shade[i] : -2;
      if (one !== shade) {
        shade = one;
        pen.fillStyle = one < 0 ? colours.faded : colours.shades[one];
      }
      pen.fillRect(this.xOf(column.data[i]) - size / 2, y(i) - size / 2, size, size);
    }
  }

  /** @param {number} width @param {number} height */
  paintScale(width, height) {
    const { pen, colours } = this;
    const [low, high] = this.ends();
    pen.strokeStyle = colours.soft;
    pen.lineWidth = 1;
    pen.beginPath();
    pen.moveTo(EDGE.left, height - EDGE.bottom + 0.5);
    pen.lineTo(width - EDGE.right, height - EDGE.bottom + 0.5);
    if (this.axis >= 0) pen.stroke();
    pen.fillStyle = colours.soft;
    pen.font = "12px system-ui, sans-serif";
    pen.textBaseline = "bottom";
    const beyond = this.axis < 0 && this.cloud.value.beyond ? "\u2265\u202f" : "";
    const decimals = Math.max(0, Math.min(6, Math.ceil(-Math.log10((high - low) / 100))));
    const number = (value) => formatFixed(value, value === 0 ? 0 : decimals);
    [
      [low, "left", ""],
      [(low + high) / 2, "center", ""],
      [high, "right", beyond],
    ].forEach(([value, align, before]) => {
      pen.textAlign = align;
      pen.fillText(before + number(value), this.xOf(value), height);
    });
  }
}
