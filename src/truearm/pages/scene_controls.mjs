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

/**
 * @param {string} text numbers separated by spaces, semicolons, tabs or commas
 * @param {number} count
 * @returns {number[] | null}
 */
export function parseNumbers(text, count) {
  let parts = text
    .trim()
    .split(/[\s;]+|,\s+/)
    .filter((part) => part !== "");
  if (parts.length !== count) parts = text.split(",");
  const numbers = parts.map((part) => parseFloat(part.trim().replace(",", ".").replace("\u2212", "-")));
  return numbers.length === count && numbers.every(Number.isFinite) ? numbers : null;
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
    this.all = this.allField();
    this.element = build("div", { className: "mechanism" }, this.place, this.table(), this.all);
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
      if (field.value !== "" && Number.isFinite(field.valueAsNumber)) this.set(i, field.valueAsNumber, field);
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
    const note = build("span", { className: "note", aria: { role: "status" } });
    input.addEventListener("input", () => {
      const numbers = parseNumbers(input.value, count);
      note.textContent = numbers || !input.value.trim() ? "" : `expected ${count} numbers, separated by spaces`;
      if (numbers) this.setAll(numbers, input);
    });
    this.allInput = input;
    return build("label", { className: "all" }, `all ${count}, as one line`, input, note);
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
      field.classList.toggle("outside", outside);
      field.setAttribute("aria-invalid", outside);
      field.title = outside ? "outside the limits" : "";
    });
    if (this.allInput && this.allInput !== typing)
      this.allInput.value = this.values.map((v) => Number(v.toFixed(4))).join(" ");
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
