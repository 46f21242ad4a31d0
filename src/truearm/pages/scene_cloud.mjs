// Points with values: their numbers, their colours, which of them are selected.

const SHADES = 48;

/** @param {number} value @param {number} digits @returns {string} with so many significant digits, and a real minus */
export function formatNumber(value, digits) {
  if (value === 0) return "0";
  const decimals = Math.max(0, digits - 1 - Math.floor(Math.log10(Math.abs(value))));
  return formatFixed(value, Math.min(decimals, 8));
}

/** @param {number} value @param {number} decimals @returns {string} a zero has no sign */
export function formatFixed(value, decimals) {
  const text = Math.abs(value).toFixed(decimals);
  return value < 0 && Number(text) !== 0 ? `\u2212${text}` : text;
}

/** @param {{data: number[], step: number}} column whole numbers of steps @returns {Float64Array} */
function columnValues(column) {
  return Float64Array.from(column.data, (whole) => whole * column.step);
}

/** Points in space, the columns of numbers that belong to them, and ranges that select some of them. */
export class Cloud {
  /** @param {object} data the part `points` of the scene's data */
  constructor(data) {
    this.noun = data.noun;
    this.total = data.total;
    this.names = data.names.last.map((last) => `${data.names.before}${last}`);
    this.at = data.at.map(columnValues);
    this.count = this.at[0].length;
    this.values = data.values.map((column) => ({ ...column, data: columnValues(column) }));
    this.notes = data.notes.map((column) => ({ ...column, data: columnValues(column) }));
    this.axes = data.axes.map((column) => ({ ...column, data: columnValues(column) }));
    // Between two ends, each by the number of its point; and the labels of marked points.
    this.spans = new Map(data.spans.map(([i, ...ends]) => [i, [ends.slice(0, 3), ends.slice(3)]]));
    this.marked = new Map(data.marked);
    this.selected = new Uint8Array(this.count).fill(1);
    this.ranges = new Map();
    this.show(data.shown);
  }

  /** @param {number} series which of the values colours the points */
  show(series) {
    this.series = series;
    this.value = this.values[series];
    this.ranges.delete(-1);
    const { data, top } = this.value;
    this.shade = Uint8Array.from(data, (value) => Math.min(SHADES - 1, Math.floor((SHADES * value) / top)));
    // The largest on top, else the many small ones hide them.
    this.order = Uint32Array.from(data.keys()).sort((a, b) => data[a] - data[b]);
    this.select();
  }

  /** @param {number} axis -1: the value itself @returns {{name: string, unit: string, data: Float64Array}} */
  column(axis) {
    return axis < 0 ? this.value : this.axes[axis];
  }

  /** @param {number} axis @param {[number, number] | null} range null: no limits */
  limit(axis, range) {
    if (range === null) this.ranges.delete(axis);
    else this.ranges.set(axis, range);
    this.select();
  }

  /** Select the points that lie in all ranges. */
  select() {
    this.selected.fill(1);
    for (const [axis, [low, high]] of this.ranges) {
      const { data } = this.column(axis);
      for (let i = 0; i < this.count; i += 1) if (data[i] < low || data[i] > high) this.selected[i] = 0;
    }
  }

  /** @returns {string} which points are selected, and their values */
  summary() {
    const { data, name, unit } = this.value;
    let [n, sum, largest] = [0, 0, 0];
    for (let i = 0; i < this.count; i += 1) {
      if (this.selected[i]) [n, sum, largest] = [n + 1, sum + data[i], Math.max(largest, data[i])];
    }
    const more = this.total > this.count ? ` of the view, ${this.total} in all` : "";
    const which = this.ranges.size
      ? `${n} of ${this.count} ${this.noun}s selected`
      : `All ${this.count} ${this.noun}s${more}`;
    const numbers = n
      ? `mean ${formatNumber(sum / n, 3)} ${unit}, largest ${formatNumber(largest, 3)} ${unit}`
      : "none";
    const ranges = [...this.ranges].map(([axis, [low, high]]) => {
      const column = this.column(axis);
      const end = high === Infinity ? `${column.unit} or more` : `to ${formatNumber(high, 3)} ${column.unit}`;
      return `${column.name} ${formatNumber(low, 3)} ${end}`;
    });
    return `${which}: ${name}, ${numbers}.${ranges.length ? ` Selected by ${ranges.join("; ")}.` : ""}`;
  }

  /** @param {number} i @returns {string[]} what is known of a point, a line each */
  describe(i) {
    const line = (column) => `${column.name} ${formatNumber(column.data[i], 3)} ${column.unit}`;
    return [
      this.names[i],
      line(this.value),
      ...this.notes.map(line),
      ...this.values.filter((column) => column !== this.value).map(line),
      ["x", "y", "z"].map((axis, k) => `${axis} ${formatFixed(this.at[k][i], 1)}`).join(", "),
      this.axes.map((column) => `${column.name} ${formatFixed(column.data[i], 1)}`).join(", "),
    ].filter((text) => text !== "");
  }
}

/** @param {string} list colours #rrggbb, separated by commas @returns {string[]} as many shades between them */
export function shadesBetween(list) {
  const stops = list.split(",").map((text) => [1, 3, 5].map((k) => parseInt(text.trim().slice(k, k + 2), 16)));
  return Array.from({ length: SHADES }, (_, i) => {
    const place = (i / (SHADES - 1)) * (stops.length - 1);
    const from = Math.min(Math.floor(place), stops.length - 2);
    const mixed = stops[from].map((value, k) => Math.round(value + (place - from) * (stops[from + 1][k] - value)));
    return `rgb(${mixed.join(" ")})`;
  });
}
