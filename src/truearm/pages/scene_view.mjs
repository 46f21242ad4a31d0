// The view: the space on a canvas that is turned, zoomed and pointed at, with the plots and controls beside it.

import { boundsOf, Camera, framesOf } from "./scene_space.mjs";
import { Cloud } from "./scene_cloud.mjs";
import { Painter } from "./scene_paint.mjs";
import { RangePlot } from "./scene_plots.mjs";
import { build, buttonBar, chooser, MechanismControls } from "./scene_controls.mjs";

const HELP =
  "Drag to turn, shift and drag to move, pinch or + and \u2212 to zoom. " +
  "Keys: arrows turn, shift and arrows move, 0 resets";
const HELP_OF_POINTS = "; n and p go through the points from the largest value; drag in a plot to select a range";
const SMALL_PART = 0.6; // of the scene; points that fill more of it need no view of their own
const VIEWS = { front: [-90, 0], side: [0, 0], top: [-90, 90] };

/** One interactive scene in its figure. */
export class SceneView {
  /** @param {HTMLElement} figure @param {object} data */
  constructor(figure, data) {
    this.lines = data.lines;
    this.unit = data.unit;
    this.mechanism = data.mechanism;
    this.cloud = data.points ? new Cloud(data.points) : null;
    this.values = this.mechanism ? [...this.mechanism.start] : [];
    this.current = -1;
    this.showLengths = Boolean(this.mechanism && this.mechanism.controls);
    this.bounds = boundsOf(this.extent());
    this.near = this.cloud && boundsOf(this.cloudExtent());
    this.camera = new Camera(this.bounds);
    this.changed = true;
    this.pointers = new Map();
    this.build(figure, data);
    this.painter = new Painter(this.canvas, this);
    this.listen();
    this.watch(figure);
  }

  /** @returns {number[][]} points that the first view shows */
  extent() {
    const points = this.lines.flatMap((line) => line.at);
    if (this.cloud) points.push(...this.cloudExtent());
    if (this.mechanism) {
      const frames = framesOf(this.mechanism, this.mechanism.start);
      points.push(...this.mechanism.links[0], frames.end);
      const axis = 1.2 * this.mechanism.size;
      frames.before.forEach((f) =>
        [-0.6, 1].forEach((s) => points.push([3, 7, 11].map((k) => f[k] + s * axis * f[k - 1]))),
      );
    }
    return points;
  }

  /** @returns {number[][]} the points, and the ends of what they stand for */
  cloudExtent() {
    const [x, y, z] = this.cloud.at;
    const points = Array.from(x, (value, i) => [value, y[i], z[i]]);
    this.cloud.spans.forEach((ends) => points.push(...ends));
    return points;
  }

  /** @param {HTMLElement} figure @param {object} data */
  build(figure, data) {
    const help = build("p", {
      className: "help",
      id: `${figure.id}-help`,
      textContent: `${HELP}${data.points ? HELP_OF_POINTS : ""}.`,
    });
    this.canvas = build("canvas", {
      className: "space",
      tabIndex: 0,
      aria: { role: "application", "aria-label": data.label, "aria-describedby": help.id },
    });
    this.note = build("div", { className: "readout", hidden: true, aria: { role: "status" } });
    const space = build("div", { className: "space-frame" }, this.canvas, this.note);
    const main = build("div", { className: "scene-main" }, this.bar(), space);
    const beside = build("div", { className: "scene-beside" });
    const stage = build("div", { className: "stage" }, main, beside, help);
    if (this.cloud) this.buildPlots(main, beside);
    if (this.mechanism?.controls) {
      this.controls = new MechanismControls(this.mechanism, this.values, () => this.refresh());
      beside.append(this.controls.element);
    }
    figure.prepend(stage);
    figure.classList.add("live");
  }

  /** @returns {HTMLElement} */
  bar() {
    const look = (name) => [name, () => this.look(() => this.camera.look(...VIEWS[name]))];
    const actions = [
      ...Object.keys(VIEWS).map(look),
      ["+", () => this.look(() => this.camera.magnify(1.3))],
      ["\u2212", () => this.look(() => this.camera.magnify(1 / 1.3))],
      ...(this.cloud && this.near.radius < SMALL_PART * this.bounds.radius
        ? [["points", () => this.look(() => this.camera.approach(this.near))]]
        : []),
      ["reset", () => this.look(() => this.camera.reset())],
    ];
    const bar = buttonBar(actions, "view");
    if (this.cloud && this.cloud.values.length > 1) {
      const names = this.cloud.values.map((value) => value.name);
      bar.append(chooser("colour:", names, this.cloud.series, (i) => this.act(() => this.cloud.show(i))));
    }
    if (this.mechanism?.controls) {
      const box = build("input", { type: "checkbox", checked: true });
      box.addEventListener("change", () => this.act(() => (this.showLengths = box.checked)));
      bar.append(build("label", { className: "chooser" }, box, ` lengths [${this.unit}]`));
    }
    return bar;
  }

  /** @param {HTMLElement} main @param {HTMLElement} beside */
  buildPlots(main, beside) {
    const axes = [-1, ...this.cloud.axes.keys()];
    this.plots = axes.map((axis) => new RangePlot(this.cloud, axis, () => this.refresh()));
    this.status = build("p", { className: "selected", aria: { role: "status" } });
    const all = build("button", { type: "button", textContent: "select all" });
    all.addEventListener("click", () => {
      this.cloud.ranges.clear();
      this.cloud.select();
      this.refresh();
    });
    main.append(this.status);
    beside.append(build("div", { className: "plots" }, ...this.plots.map((plot) => plot.element)), all);
  }

  /** @param {() => void} change of the camera: the plots stay as they are */
  look(change) {
    change();
    this.refresh(false);
  }

  /** @param {() => void} change */
  act(change) {
    change();
    this.refresh();
  }

  /**
   * Draw once before the next frame, however often it is asked for.
   * @param {boolean} [plots] whether the plots have changed too
   */
  refresh(plots = true) {
    this.hide();
    this.changed = this.changed || plots;
    this.drawSoon();
  }

  drawSoon() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      this.draw();
    });
  }

  /**
   * Bring a mechanism that moves by itself to new values; what a reader points at stays.
   * @param {number[]} values @param {number[] | null} ghost the values at which it is drawn translucent, too
   */
  move(values, ghost) {
    this.values = values;
    this.ghost = ghost;
    this.include([values, ghost].filter(Boolean).flatMap((at) => this.pivots(at)));
    this.drawSoon();
  }

  /** @param {number[][]} points that the picture shows, with the floor below them */
  include(points) {
    if (this.camera.include(points)) this.bounds = { ...boundsOf(this.camera.seen), low: this.bounds.low };
  }

  /** @param {number[]} values @returns {number[][]} where the mechanism's pivots and its end are */
  pivots(values) {
    const { before, end } = framesOf(this.mechanism, values);
    return [...before.map((frame) => [3, 7, 11].map((k) => frame[k])), end];
  }

  /** Other points, in a view that began without any. @param {object} points as the part `points` of the data */
  replaceCloud(points) {
    this.cloud = new Cloud(points);
    if (this.cloud.count) this.include(this.cloudExtent());
    this.refresh(false);
  }

  /**
   * Another mechanism of as many pivots, perhaps elsewhere; the points of the one before go.
   * @param {object} mechanism as the part of the data @param {object[]} lines
   */
  replaceMechanism(mechanism, lines) {
    Object.assign(this, { mechanism, lines, cloud: null });
    this.bounds = boundsOf(this.extent());
    const { width, height } = this.camera;
    this.camera = new Camera(this.bounds);
    this.camera.fit(width, height);
    this.drawSoon();
  }

  draw() {
    this.painter.paint();
    if (this.plots && this.changed) {
      this.plots.forEach((plot) => plot.paint());
      const text = this.cloud.summary();
      if (this.status.textContent !== text) this.status.textContent = text;
    }
    this.changed = false;
  }

  /** @param {HTMLElement} figure */
  watch(figure) {
    new ResizeObserver(() => this.refresh()).observe(figure);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.refresh());
    this.draw();
  }

  listen() {
    const { canvas } = this;
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
      this.moved = 0;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (this.pointers.has(event.pointerId)) this.drag(event);
      else this.hover(event.offsetX, event.offsetY, 10);
    });
    ["pointerup", "pointercancel"].forEach((name) =>
      canvas.addEventListener(name, (event) => {
        this.pointers.delete(event.pointerId);
        if (name === "pointerup" && this.moved < 5) this.hover(event.offsetX, event.offsetY, 18);
      }),
    );
    canvas.addEventListener("pointerleave", () => this.hide());
    canvas.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    canvas.addEventListener("keydown", (event) => this.press(event));
  }

  /** @param {PointerEvent} event one pointer turns, or moves with shift; two zoom and move */
  drag(event) {
    const [x, y] = this.pointers.get(event.pointerId);
    const [dx, dy] = [event.offsetX - x, event.offsetY - y];
    const before = this.spread();
    this.pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.moved += Math.hypot(dx, dy);
    if (this.pointers.size > 1) {
      if (before) this.camera.magnify(this.spread() / before);
      this.camera.pan(dx / 2, -dy / 2);
    } else if (event.shiftKey || event.buttons === 4 || event.buttons === 2) {
      this.camera.pan(dx, -dy);
    } else {
      this.camera.turn(-0.4 * dx, 0.4 * dy);
    }
    this.refresh(false);
  }

  /** @returns {number} distance of two pointers in pixels */
  spread() {
    if (this.pointers.size < 2) return 0;
    const [[x0, y0], [x1, y1]] = [...this.pointers.values()];
    return Math.hypot(x1 - x0, y1 - y0);
  }

  /** @param {WheelEvent} event the wheel scrolls the page until the view has the focus */
  wheel(event) {
    if (!event.ctrlKey && document.activeElement !== this.canvas) return;
    event.preventDefault();
    this.look(() => this.camera.magnify(Math.exp(-0.0015 * event.deltaY), event.offsetX, event.offsetY));
  }

  /** @param {KeyboardEvent} event */
  press(event) {
    const [across, up] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[event.key] ?? [
      0, 0,
    ];
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (across || up) {
      this.look(() =>
        event.shiftKey ? this.camera.pan(30 * across, 30 * up) : this.camera.turn(-8 * across, -8 * up),
      );
    } else if (event.key === "+" || event.key === "=") this.look(() => this.camera.magnify(1.2));
    else if (event.key === "-") this.look(() => this.camera.magnify(1 / 1.2));
    else if (event.key === "0") this.look(() => this.camera.reset());
    else if (event.key === "Escape") this.hide();
    else if ("np".includes(event.key) && this.plots) this.step(event.key === "n" ? 1 : -1);
    else return;
    event.preventDefault();
  }

  /** @param {number} way to the selected point with the next smaller, or larger, value */
  step(way) {
    const falling = [...this.cloud.order].reverse().filter((i) => this.cloud.selected[i]);
    if (!falling.length) return;
    const place = falling.indexOf(this.last ?? -1);
    const next = place < 0 ? 0 : (place + way + falling.length) % falling.length;
    this.tell(falling[next]);
  }

  /** @param {number} x @param {number} y @param {number} within so many pixels */
  hover(x, y, within) {
    const found = this.painter.pointAt(x, y, within);
    if (found === this.current) return;
    if (found < 0) this.hide();
    else this.tell(found);
  }

  /** @param {number} i say what is known of a point, and bring the mechanism there */
  tell(i) {
    this.current = i;
    this.last = i;
    if (this.mechanism?.follows) {
      this.mechanism.follows.forEach((axis, k) => {
        this.values[k] = this.cloud.axes[axis].data[i];
      });
      this.controls?.update();
    }
    this.painter.paint();
    this.note.replaceChildren(...this.cloud.describe(i).map((text) => build("span", { textContent: text })));
    this.note.hidden = false;
    const [x, y] = [this.painter.flat[2 * i], this.painter.flat[2 * i + 1]];
    const { offsetWidth: width, offsetHeight: height } = this.note;
    const left = Math.max(4, Math.min(x + 14, this.canvas.clientWidth - width - 4));
    const above = y - height - 14;
    this.note.style.left = `${left}px`;
    this.note.style.top = `${above > 4 ? above : Math.min(y + 14, this.canvas.clientHeight - height - 4)}px`;
  }

  hide() {
    if (this.current < 0) return;
    this.current = -1;
    this.note.hidden = true;
    if (!this.waiting) this.painter.paint();
  }
}

/** Make every scene interactive that the browser has read, and the later ones when it has read the page. */
export function start() {
  document.querySelectorAll("figure.scene:not(.live)").forEach((figure) => {
    const data = JSON.parse(figure.querySelector("script[type='application/json']").textContent);
    figure.view = new SceneView(figure, data);
  });
  performance.mark("scenes drawn"); // read by the benchmark of the pages
  if (document.readyState === "loading") document.addEventListener("DOMContentLoaded", start, { once: true });
}
