// What a reader types and presses: sliders and fields of a mechanism, views, the choice of the value.

import { framesOf, rollPitchYaw } from "./scene_space.mjs";
import { formatFixed } from "./scene_cloud.mjs";

/**
 * @param {string} tag
 * @param {object} properties of the element; `aria` and `data` are attributes
 * @param {(Node | string)[]} children
 * @returns {HTMLElement}
 */
export function build(tag, properties = {}, ...children) {
  const { aria = {}, ...rest } = properties;
  const element = Object.assign(document.createElement(tag), rest);
  Object.entries(aria).forEach(([name, value]) => element.setAttribute(name, value));
  element.append(...children);
  return element;
}

// One number: a decimal point or comma, and no sign that separates thousands.
const NUMBER = /^[-+\u2212]?(\d+([.,]\d*)?|[.,]\d+)(e[-+]?\d+)?$/i;

/**
 * @param {string} text numbers separated by spaces, semicolons, tabs or commas
 * @param {number} count
 * @returns {number[]}
 * @throws {Error} says which of them is no number, or that there are more or fewer
 */
export function parseNumbers(text, count) {
  const given = text.trim();
  let parts = given.split(/[\s;]+|,\s+/).filter((part) => part !== "");
  if (parts.length !== count && given.split(",").length === count) parts = given.split(",");
  parts = parts.map((part) => part.trim());
  const wrong = parts.find((part) => !NUMBER.test(part));
  if (wrong !== undefined) throw new Error(`expected ${count} numbers, separated by spaces; "${wrong}" is none`);
  if (parts.length !== count) throw new Error(`expected ${count} numbers, separated by spaces, got ${parts.length}`);
  return parts.map((part) => Number(part.replace(",", ".").replace("\u2212", "-")));
}

/** A slider and a field for each pivot, a field for all of them, and where the end then is. */
export class MechanismControls {
  /** @param {object} mechanism @param {number[]} values changed in place @param {() => void} changed */
  constructor(mechanism, values, changed) {
    this.mechanism = mechanism;
    this.values = values;
    this.changed = changed;
    this.rows = mechanism.names.map((name, i) => this.row(name, i));
    this.place = build("table", { className: "end" });
    this.note = build("p", { className: "note", aria: { role: "status" } });
    this.all = this.allField();
    this.element = build("div", { className: "mechanism" }, this.place, this.table(), this.all, this.note);
    this.update();
  }

  /** @param {string} name @param {number} i @returns {{slider: HTMLInputElement, field: HTMLInputElement}} */
  row(name, i) {
    const { low, high, units } = this.mechanism;
    const unit = units[i];
    const slider = build("input", {
      type: "range",
      min: low[i],
      max: high[i],
      step: "any",
      aria: { "aria-label": `${name}, slider [${unit}]` },
    });
    const field = build("input", { type: "number", step: "any", aria: { "aria-label": `${name} [${unit}]` } });
    slider.addEventListener("input", () => this.set(i, Math.round(Number(slider.value) * 10) / 10));
    field.addEventListener("input", () => {
      if (Number.isFinite(field.valueAsNumber)) this.set(i, field.valueAsNumber, field);
      else this.refuse(field, `${name}: expected a number`);
    });
    return { slider, field };
  }

  /** @returns {HTMLElement} */
  table() {
    const { names, units, low, high, limited } = this.mechanism;
    const heads = ["", "", this.mechanism.valueName, "limits"].map((text, k) =>
      text ? build("th", { scope: "col", textContent: text }) : build("td", k ? {} : { className: "name" }),
    );
    const rows = this.rows.map(({ slider, field }, i) => {
      const limits = limited[i] ? `${formatFixed(low[i], 0)} to ${formatFixed(high[i], 0)}` : "none";
      return build(
        "tr",
        {},
        build("th", { scope: "row", textContent: names[i] }),
        build("td", {}, slider),
        build("td", {}, field, ` ${units[i]}`),
        build("td", { className: "limits", textContent: limits }),
      );
    });
    return build("table", {}, build("thead", {}, build("tr", {}, ...heads)), build("tbody", {}, ...rows));
  }

  /** @returns {HTMLElement} */
  allField() {
    const count = this.values.length;
    const input = build("input", { type: "text", autocomplete: "off", spellcheck: false });
    input.addEventListener("input", () => {
      try {
        this.setAll(parseNumbers(input.value, count), input);
      } catch (fault) {
        this.refuse(input, fault.message);
      }
    });
    this.allInput = input;
    return build("label", { className: "all" }, `all ${count}, as one line`, input);
  }

  /** Mark an entry that cannot be used; nothing moves. @param {HTMLInputElement} input @param {string} problem */
  refuse(input, problem) {
    mark(input, problem);
    this.note.textContent = problem;
  }

  /** @param {number} i @param {number} value @param {Element} [typing] a field that is not written to */
  set(i, value, typing) {
    this.values[i] = value;
    this.update(typing);
    this.changed();
  }

  /** @param {number[]} values @param {Element} [typing] */
  setAll(values, typing) {
    values.forEach((value, i) => {
      this.values[i] = value;
    });
    this.update(typing);
    this.changed();
  }

  /** Write the values to all fields but the one that is typed in, and where the end is. @param {Element} [typing] */
  update(typing) {
    const { low, high, limited } = this.mechanism;
    this.rows.forEach(({ slider, field }, i) => {
      slider.value = this.values[i];
      if (field !== typing) field.value = Number(this.values[i].toFixed(4));
      const outside = limited[i] && (this.values[i] < low[i] || this.values[i] > high[i]);
      mark(field, outside ? "outside the limits" : "");
    });
    if (this.allInput !== typing) this.allInput.value = this.values.map((v) => Number(v.toFixed(4))).join(" ");
    mark(this.allInput, "");
    this.note.textContent = "";
    this.writePlace();
  }

  writePlace() {
    const { mechanism } = this;
    const frames = framesOf(mechanism, this.values);
    const rows = [
      [`${mechanism.endName} [${mechanism.unit}]`, ["x", "y", "z"], frames.end],
      ["orientation [deg]", ["roll", "pitch", "yaw"], rollPitchYaw(frames.last)],
    ];
    this.place.replaceChildren(
      ...rows.map(([head, names, numbers]) =>
        build(
          "tr",
          {},
          build("th", { scope: "row", textContent: head }),
          ...names.map((name, k) => build("td", {}, build("small", { textContent: name }), formatFixed(numbers[k], 3))),
        ),
      ),
    );
  }
}

/** @param {HTMLInputElement} input @param {string} problem empty: there is none */
function mark(input, problem) {
  input.classList.toggle("outside", problem !== "");
  input.setAttribute("aria-invalid", problem !== "");
  input.title = problem;
}

/** @param {[string, () => void][]} actions @param {string} label @returns {HTMLElement} buttons in a row */
export function buttonBar(actions, label) {
  const buttons = actions.map(([text, act]) => {
    const button = build("button", { type: "button", textContent: text });
    button.addEventListener("click", act);
    return button;
  });
  return build("div", { className: "buttons", aria: { role: "group", "aria-label": label } }, ...buttons);
}

/**
 * @param {string} label
 * @param {string[]} options
 * @param {number} chosen
 * @param {(i: number) => void} choose
 * @returns {HTMLElement}
 */
export function chooser(label, options, chosen, choose) {
  const select = build("select", {}, ...options.map((text, i) => build("option", { value: i, textContent: text })));
  select.value = chosen;
  select.addEventListener("change", () => choose(Number(select.value)));
  return build("label", { className: "chooser" }, `${label} `, select);
}
