// The page of a connected arm: messages of the server in, commands out. What it draws in space is the scene's.

import { formatFixed } from "./scene_cloud.mjs";
import { build } from "./scene_controls.mjs";
import { coloursOf } from "./scene_paint.mjs";

const SILENT_MS = 600; // without a sample; a source says the same after a second
const RETRY_MS = 1000;
const MOST_EVENTS = 50;
const FEWEST_TO_FIT = 4; // readings: base and tip alone take so many
const USUAL_TO_FIT = 12;
const SURE_MS = 5000; // in which a reading is removed by a second press
const STEER_MS = 100; // between commands to a virtual arm, which follows its sliders

const at = (id) => document.getElementById(id);
const view = at("scene").view;
const settings = JSON.parse(at("settings").textContent);
const { spans } = settings;
const rows = [...document.querySelectorAll("#joints tbody tr")];
const sliders = rows.map((row) => row.querySelector("input")).filter(Boolean); // of a virtual arm
const tracks = rows.map(() => document.createElement("canvas")); // the strips without the pose, which is drawn far more often
const live = { readings: [], changes: 0, aim: null, pose: null, drawn: "", steered: null, lastSteer: 0, arrived: 0, run: "", ended: "", mayCommand: false, isLost: false, socket: null, uncertainties: [], model: null, files: {}, removes: 0 };

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
    const asked = message.is_asked ? "Another page asks for the command." : "";
    const shows = message.asks ? "Asked for the command: it comes when the other page gives it, or closes." : "This page only shows: another one commands.";
    write("role", live.ended ? "" : live.mayCommand ? asked : message.is_free ? "No page commands: ask, and this one does." : shows);
    at("ask").hidden = live.mayCommand || message.asks;
    at("give").hidden = !message.is_asked;
    showButtons();
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
    live.uncertainties = message.uncertainties_mm;
    live.model = message.model?.event ?? null;
    live.files = message.files;
    at("events").replaceChildren();
    message.events.forEach(({ event }) => say(event.text, event.event));
    [message.learned, message.next].filter(Boolean).forEach(tell);
    showReadings();
    showTiles();
  },
  said(message) {
    const { event, reading } = message;
    if (event.event === "reading") live.readings.push(reading);
    if (event.event === "undone") live.readings.pop();
    if (event.event === "end") live.ended = event.text;
    if (event.event === "model") live.model = event;
    if (event.event === "notice" && event.file) live.files.model = event.file;
    if (event.event === "learned") {
      const n = live.readings.length;
      live.uncertainties = [...live.uncertainties.filter(([before]) => before < n), [n, event.after_mm]];
    }
    tell(message);
    if (event.event === "reading" || event.event === "undone") showReadings();
    showTiles();
  },
  pose(message) {
    live.pose = message;
    live.arrived = performance.now();
    showPose();
  },
  refused: ({ text }) => say(text, "refused"),
};

/** @param {object} message an event: where it is read */
function tell({ event, aim_pivots: ghost }) {
  if (event.event === "learned") {
    write("learned", event.text);
  } else if (event.event === "next") {
    write("next", event.text);
    live.aim = event.aim ? { joints: event.aim, pivots: ghost } : null;
  } else {
    say(event.text, event.event);
  }
}

/** How far the recording is: readings, uncertainty, model; and its end. */
function showTiles() {
  const { readings, uncertainties, model, files } = live;
  const poses = settings.n_poses;
  write("count", poses ? `${readings.length} of ${poses}` : `${readings.length}`);
  at("progress").hidden = !poses;
  at("progress").value = poses ? Math.min(1, readings.length / poses) : 0;
  const known = uncertainties.filter(([n]) => n <= readings.length);
  write("uncertainty", known.length ? `${formatFixed(known.at(-1)[1], 3)} mm` : "\u2013");
  showCurve(known);
  write("model", model ? model.model : isCorrected() ? "given" : "none");
  const error = model?.held_out_mm ? `: ${formatFixed(model.held_out_mm, 3)} mm on held-out readings` : "";
  const before = error && model.model !== "nominal" ? `, nominal arm ${formatFixed(model.nominal_mm, 3)} mm` : "";
  write("model-words", model ? `model of ${model.n} readings${error}${before}` : "model in force");
  document.body.classList.toggle("ended", live.ended !== "");
  at("end").hidden = !live.ended;
  if (live.ended) showEnd(files);
  showButtons();
}

/** @param {number[][]} known numbers of readings, and the uncertainty with them, on a logarithmic scale */
function showCurve(known) {
  const curve = at("curve");
  curve.toggleAttribute("hidden", known.length < 2);
  if (known.length < 2) return;
  const [first, last] = [known[0], known.at(-1)];
  const logs = known.map(([, mm]) => Math.log(mm));
  const [low, high] = [Math.min(...logs), Math.max(...logs)];
  const points = known.map(([n], i) => [
    (100 * (n - first[0])) / (last[0] - first[0]),
    28 - (26 * (logs[i] - low)) / (high - low || 1),
  ]);
  curve.firstElementChild.setAttribute("points", points.map(([x, y]) => `${x.toFixed(1)},${y.toFixed(1)}`).join(" "));
  const said = [first, last].map(([n, mm]) => `${formatFixed(mm, 3)} mm after ${n}`);
  curve.setAttribute("aria-label", `uncertainty by readings: ${said.join(", ")}`);
}

/** @param {Object<string, string>} files what was recorded, and what it is good for */
function showEnd(files) {
  write("recorded", `${live.ended}.`);
  write("role", "");
  const rows = Object.entries(files).flatMap(([what, file]) => [
    build("dt", { textContent: what }),
    build("dd", { textContent: file }),
  ]);
  at("files").replaceChildren(...rows);
  /** @param {string} path */
  const quoted = (path) => (/^[\w./:\\-]+$/.test(path) ? path : `"${path}"`);
  const fit = `truearm fit ${quoted(files.session)} --arm ${quoted(settings.arm)} --out arm.truearm`;
  write("after", files.model ? "Correct the joint targets of a program with the model:" : "Fit a model to the readings:");
  write("after-command", files.model ? `truearm correct ${quoted(files.model)} targets.csv --out corrected.csv` : fit);
}

/** @returns {boolean} whether a model corrects the tip */
function isCorrected() {
  return live.pose !== null && (live.pose.corrected_mm !== null || live.pose.not_corrected !== "");
}

/** @returns {string} what a person does next */
function whatToDo() {
  const { pose, aim, readings } = live;
  if (live.ended || !live.mayCommand) return "";
  if (pose === null) return "Waiting for the first sample of the arm.";
  if (pose.is_fitting) return "A model is being fitted. Further readings are taken meanwhile.";
  const canFit = readings.length >= FEWEST_TO_FIT;
  const hasSave = document.querySelector("[data-command=save]");
  if (live.model && hasSave && !live.files.model) return "Press w to save the model, or go on measuring.";
  if (at("next") && !aim && canFit) return live.model ? "The plan is done." : "The plan is done: press r to fit a model.";
  if (!live.model && readings.length >= USUAL_TO_FIT) return "Press r to fit a model, or go on measuring.";
  const by = settings.takes_by_itself ? "A reading is taken when it stands still" : "Press t when it stands still";
  if (aim && sliders.length) return `Press g: the arm goes to the next pose. ${by}.`;
  return aim ? `Bring the arm to the translucent pose. ${by}.` : `Bring the arm to a new pose. ${by}.`;
}

/** @returns {Object<string, string>} why each command cannot be done now */
function reasons() {
  const { pose, aim, readings } = live;
  const n = readings.length;
  const everything = live.ended ? "the recording has ended" : live.mayCommand ? "" : "another page commands";
  const next = aim ? "" : "there is no next pose";
  const few = n < FEWEST_TO_FIT ? `a fit needs ${FEWEST_TO_FIT} readings, there are ${n}` : "";
  const own = {
    take: pose ? "" : "the arm has sent no sample yet",
    undo: n ? "" : "there is no reading yet",
    skip: next,
    go: next,
    refit: pose?.is_fitting ? "a fit is under way" : few,
    save: live.model || isCorrected() ? "" : "no model is in force yet",
  };
  return { everything, own };
}

/** Which buttons work, and why the others do not. */
function showButtons() {
  const { everything, own } = reasons();
  const off = [];
  document.querySelectorAll("button[data-command]").forEach((button) => {
    const why = everything || own[button.dataset.command];
    button.disabled = why !== "";
    button.title = why;
    if (why && !everything) off.push(`${button.firstChild.textContent.trim()}: ${why}`);
  });
  document.querySelectorAll("form[data-command] :is(button, input), #joints input").forEach((one) => {
    one.disabled = everything !== "";
  });
  write("off", off.join(" \u00b7 "));
  write("todo", whatToDo());
}

/** Remove the last reading, if it is asked for twice. @param {HTMLElement} button */
function undo(button) {
  const n = live.readings.length;
  const isSure = live.removes === n;
  live.removes = isSure ? 0 : n;
  button.firstElementChild.textContent = isSure ? "Undo" : `Remove reading ${n}?`;
  if (isSure) ask("undo");
  else setTimeout(() => live.removes === n && undoNothing(button), SURE_MS);
}

/** @param {HTMLElement} button */
function undoNothing(button) {
  live.removes = 0;
  button.firstElementChild.textContent = "Undo";
}

/** The tip, the joints and the arm as they are now. */
function showPose() {
  const { pose } = live;
  const tip = isCorrected() ? pose.corrected_mm : pose.tip_in_base_mm;
  write("tip-title", isCorrected() ? "Corrected tip" : "Tip of the nominal arm, in its base");
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
  showButtons();
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
    if (!width || !height) return;
    if (canvas.width !== Math.round(width * ratio)) canvas.width = Math.round(width * ratio);
    if (canvas.height !== Math.round(height * ratio)) canvas.height = Math.round(height * ratio);
    const [low, high] = spans[i];
    const place = (value) => 6 + (width - 12) * Math.max(0, Math.min(1, (value - low) / (high - low)));
    const key = [canvas.width, canvas.height, ratio, colours.faded, colours.axis, live.changes].join();
    if (tracks[i].key !== key) {
      Object.assign(tracks[i], { key, width: canvas.width, height: canvas.height });
      const pen = tracks[i].getContext("2d");
      pen.scale(ratio, ratio);
      pen.fillStyle = colours.faded;
      pen.fillRect(6, height / 2 - 3, width - 12, 6);
      pen.fillStyle = colours.axis;
      live.readings.forEach(({ joints }) => pen.fillRect(place(joints[i]) - 1, height / 2 - 6, 2, 12));
    }
    const pen = canvas.getContext("2d");
    pen.resetTransform();
    pen.clearRect(0, 0, canvas.width, canvas.height);
    pen.drawImage(tracks[i], 0, 0);
    pen.scale(ratio, ratio);
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
  live.changes += 1;
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
  if (live.socket?.readyState === WebSocket.OPEN) live.socket.send(JSON.stringify({ command, text }));
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
  const { command } = button.dataset;
  button.addEventListener("click", () => {
    if (command === "undo") undo(button);
    else if (command === "go") steer(live.aim.joints);
    else ask(command);
  });
});
["ask", "give"].forEach((command) => at(command).addEventListener("click", () => ask(command)));
sliders.forEach((slider, i) => {
  [slider.min, slider.max] = spans[i];
  slider.addEventListener("input", () => steer(sliders.map((one) => one.valueAsNumber)));
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
