// The page of a connected arm: messages of the server in, commands out. What it draws in space is the scene's.

import { formatFixed } from "./scene_cloud.mjs";
import { build } from "./scene_controls.mjs";
import { coloursOf } from "./scene_paint.mjs";

const SILENT_MS = 600; // without a sample; a source says the same after a second
const RETRY_MS = 1000;
const MOST_EVENTS = 50;
const STEER_MS = 100; // between commands to a virtual arm, which follows its sliders

const at = (id) => document.getElementById(id);
const view = at("scene").view;
const spans = JSON.parse(at("spans").textContent);
const rows = [...document.querySelectorAll("#joints tbody tr")];
const sliders = rows.map((row) => row.querySelector("input")).filter(Boolean); // of a virtual arm
const live = { readings: [], aim: null, pose: null, drawn: "", steered: null, lastSteer: 0, arrived: 0, run: "", ended: "", mayCommand: false, isLost: false, socket: null };

/** @param {string} text @param {string} [kind] the newest event on top */
function say(text, kind = "") {
  at("events").prepend(build("li", { textContent: text, className: kind }));
  while (at("events").children.length > MOST_EVENTS) at("events").lastElementChild.remove();
}

/** @param {string} id @param {string} text written only if it changes: screen readers say what is written */
function write(id, text) {
  const element = at(id);
  if (element && element.textContent !== text) element.textContent = text;
}

const receive = {
  role(message) {
    if (live.run && live.run !== message.run) location.reload(); // another run, perhaps of another arm
    live.run = message.run;
    live.isLost = false;
    live.mayCommand = message.may_command;
    document.querySelectorAll(".stage-buttons :is(button, input), #joints input").forEach((one) => {
      one.disabled = !live.mayCommand;
    });
    write("role", live.mayCommand ? "" : "This page only shows: another one commands. Close that one and reload this.");
  },
  state(message) {
    const { mechanism, lines, is_identified: isIdentified } = message.drawn;
    const drawn = JSON.stringify(mechanism);
    if (mechanism && drawn !== live.drawn) {
      live.drawn = drawn; // after a lost connection it is the same, and so is the view
      view.replaceMechanism(mechanism, lines);
      write("drawn", isIdentified ? "identified arm, in the frame of the reference" : "nominal arm, in its base");
    }
    live.readings = message.readings;
    live.ended = message.ended;
    [message.learned, message.next].filter(Boolean).forEach(receive.said);
    showReadings();
  },
  said({ event, reading, aim_pivots: ghost }) {
    if (event.event === "reading") live.readings.push(reading);
    if (event.event === "undone") live.readings.pop();
    if (event.event === "end") live.ended = event.text;
    if (event.event === "learned") {
      write("learned", event.text);
    } else if (event.event === "next") {
      write("next", event.text);
      live.aim = event.aim ? { joints: event.aim, pivots: ghost } : null;
    } else {
      say(event.text, event.event);
    }
    if (event.event === "reading" || event.event === "undone") showReadings();
  },
  pose(message) {
    live.pose = message;
    live.arrived = performance.now();
    showPose();
  },
  refused: ({ text }) => say(text, "refused"),
};

/** The tip, the joints and the arm as they are now. */
function showPose() {
  const { pose } = live;
  const isCorrected = pose.corrected_mm !== null || pose.not_corrected !== "";
  const tip = isCorrected ? pose.corrected_mm : pose.tip_in_base_mm;
  write("tip-title", isCorrected ? "Corrected tip" : "Tip of the nominal arm, in its base");
  ["x", "y", "z"].forEach((axis, k) => {
    write(axis, tip ? formatFixed(tip[k], 3) : "\u2013");
    write(`U-${axis}`, pose.U_mm ? `U (k = 2) ${formatFixed(pose.U_mm[k], 3)}` : "");
  });
  const parts = [
    pose.is_still ? "still" : "moving",
    pose.not_corrected,
    pose.outside_training ? "outside the trained range" : pose.corrected_mm ? "within the trained range" : "",
    pose.temperature_degC === null ? "" : `${formatFixed(pose.temperature_degC, 1)} degC`,
    `${live.readings.length} reading${live.readings.length === 1 ? "" : "s"}`,
  ];
  write("condition", parts.filter(Boolean).join(" \u00b7 "));
  rows.forEach((row, i) => {
    row.querySelector(".angle").textContent = formatFixed(pose.joints[i], 2);
    if (row.querySelector(".to-go")) {
      row.querySelector(".to-go").textContent = pose.to_go ? signed(pose.to_go[i]) : "\u2013";
    }
  });
  if (performance.now() - live.lastSteer > SILENT_MS) {
    sliders.forEach((slider, i) => {
      slider.value = pose.joints[i];
    });
  }
  showStrips();
  view.move(pose.pivots, live.aim?.pivots ?? null);
}

/** @param {number} value @returns {string} with its sign */
function signed(value) {
  return `${value > 0 ? "+" : ""}${formatFixed(value, 0)}`;
}

/** For each joint the angles of the readings, the present one and the next. */
function showStrips() {
  const colours = coloursOf(view.canvas);
  const ratio = window.devicePixelRatio || 1;
  rows.forEach((row, i) => {
    const canvas = row.querySelector("canvas");
    const [width, height] = [canvas.clientWidth, canvas.clientHeight];
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const [low, high] = spans[i];
    const place = (value) => 6 + (width - 12) * Math.max(0, Math.min(1, (value - low) / (high - low)));
    pen.fillStyle = colours.faded;
    pen.fillRect(6, height / 2 - 3, width - 12, 6);
    pen.fillStyle = colours.axis;
    live.readings.forEach(({ joints }) => pen.fillRect(place(joints[i]) - 1, height / 2 - 6, 2, 12));
    if (live.pose) {
      const x = place(live.pose.joints[i]);
      pen.fillStyle = colours.mark;
      pen.beginPath();
      [[-5, 1], [5, 1], [0, 8]].forEach(([dx, y]) => pen.lineTo(x + dx, y));
      pen.fill();
    }
    if (live.aim) {
      pen.strokeStyle = colours.ink;
      pen.lineWidth = 2;
      pen.beginPath();
      pen.arc(place(live.aim.joints[i]), height / 2, 5, 0, 2 * Math.PI);
      pen.stroke();
    }
  });
}

/** The readings as points in space, coloured by residual, or in their order where there is none. */
function showReadings() {
  const { readings } = live;
  const known = readings.some((one) => one.residual_mm !== null);
  const values = readings.map((one, i) => (known ? (one.residual_mm ?? 0) : i + 1));
  const top = Math.max(...values, 1e-9);
  view.replaceCloud({
    noun: "reading",
    total: readings.length,
    shown: 0,
    names: { before: "reading ", last: readings.map((_, i) => i + 1) },
    at: [0, 1, 2].map((k) => ({ step: 1, data: readings.map((one) => one.tip_mm[k]) })),
    values: [{ name: known ? "residual" : "order", unit: known ? "mm" : "", step: 1, data: values, top }],
    axes: rows.map((row, i) => ({
      name: row.querySelector("th").textContent,
      unit: "",
      step: 1,
      data: readings.map((one) => one.joints[i]),
    })),
    notes: [],
    spans: [],
    marked: [],
  });
  const by = known ? `by residual, the largest ${formatFixed(top, 3)} mm` : "in their order";
  write("colours", readings.length ? `The points are the readings, coloured ${by}.` : "");
}

/** @param {string} command @param {string} [text] */
function ask(command, text = "") {
  if (live.mayCommand && live.socket?.readyState === WebSocket.OPEN) live.socket.send(JSON.stringify({ command, text }));
}

/** Send where the sliders are, no more often than the arm can follow. @param {number[]} joints */
function steer(joints) {
  live.lastSteer = performance.now();
  if (live.steered === null) {
    setTimeout(() => {
      ask("steer", live.steered.map((value) => value.toFixed(2)).join(" "));
      live.steered = null;
    }, STEER_MS);
  }
  live.steered = joints;
}

/** What is wrong with the connection, if anything; asked for ten times a second. */
function watch() {
  const open = live.socket?.readyState === WebSocket.OPEN;
  const silent = performance.now() - live.arrived;
  let fault = "";
  if (live.ended) fault = `The recording has ended: ${live.ended}.`;
  else if (live.isLost) fault = "There is no connection to truearm; this page tries again.";
  else if (open && live.pose === null && silent > SILENT_MS) fault = "Nothing was received from the arm yet.";
  else if (open && silent > SILENT_MS) fault = "The arm sends no samples; what is shown is its last pose.";
  document.body.classList.toggle("stale", fault !== "");
  write("fault", fault);
}

function connect() {
  const socket = new WebSocket(`${location.protocol.replace("http", "ws")}//${location.host}/live${location.search}`);
  live.socket = socket;
  live.arrived = performance.now();
  socket.addEventListener("message", ({ data }) => {
    const { message, ...rest } = JSON.parse(data);
    receive[message](rest);
  });
  socket.addEventListener("close", () => {
    live.isLost = true;
    setTimeout(connect, RETRY_MS);
  });
}

document.querySelectorAll("button[data-command]").forEach((button) => {
  button.addEventListener("click", () => ask(button.dataset.command));
});
sliders.forEach((slider, i) => {
  [slider.min, slider.max] = spans[i];
  slider.addEventListener("input", () => steer(sliders.map((one) => one.valueAsNumber)));
});
at("go")?.addEventListener("click", () => {
  if (live.aim) steer(live.aim.joints);
});
document.querySelectorAll("form[data-command]").forEach((form) => {
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    ask(form.dataset.command, form.elements.text.value);
    form.elements.text.blur();
  });
});
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
  if (event.target.matches("input:not([type=range])")) {
    if (event.key === "Escape") event.target.blur();
    return;
  }
  const control = document.querySelector(`[aria-keyshortcuts="${CSS.escape(event.key)}"]`);
  if (!control || control.disabled) return;
  event.preventDefault();
  if (control.matches("input")) control.select(); // what was typed before is replaced
  else control.click();
});
setInterval(watch, 100);
connect();
