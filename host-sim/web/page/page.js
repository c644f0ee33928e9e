"use strict";
const $ = (id) => document.getElementById(id);
const [form, status, progress, report] = ["choices", "status", "progress", "report"].map($);
let worker, files, log, judged, isBusy, next, largest;
let steps = [];

function startWorker() {
  worker?.terminate();
  const source = URL.createObjectURL(new Blob([$("worker").textContent], { type: "text/javascript" }));
  worker = new Worker(source);
  worker.onmessage = ({ data }) => handleMessage(data);
  worker.onerror = (event) => showFailure(event.message || "this browser does not start the worker");
  worker.postMessage({ module: $("module").textContent });
}

function send(request) {
  isBusy = true;
  report.setAttribute("aria-busy", "true");
  worker.postMessage(request);
}

// Options chosen in the form; null for an option that is not chosen.
function choices() {
  const number = (name) => (form.elements[name].value === "" ? null : form.elements[name].valueAsNumber);
  const compass = Number(form.elements.compass.value) || null;
  return { module: form.elements.module.value || null, compass, from_s: number("from_s"), to_s: number("to_s"), reference: form.elements.reference.value || null,
    correct: form.elements.correct.value, inclination_deg: number("inclination_deg") };
}

const DEFAULT_OPTIONS = { module: null, compass: null, from_s: null, to_s: null, reference: null };

// Clears the page for other files, or for an example without a file.
function clearPage(chosen, name) {
  if (isBusy) startWorker();
  [files, log] = [chosen, name];
  [judged, next, steps] = [null, null, []];
  form.reset();
  for (const id of ["again", "flight", "error", "logs"]) $(id).hidden = true;
  report.replaceChildren();
  document.title = $("title").textContent = "Is the compass good?";
}

const logName = () => files.map(({ name }) => name).join(", ") + (log ? `/${log}` : "") || "example.bin";

// Reads a log, by its name if the file holds several, and judges all its compasses; without a file the example log.
function openLog(chosen, name = null) {
  clearPage(chosen, name);
  showStatus(`Reading ${logName()}`, 0);
  send(requestOf("mg", DEFAULT_OPTIONS));
}

function requestOf(unit, judge) {
  if (!files.length) return { example: {}, judge };
  return { open: { names: files.map(({ name }) => name), log, unit }, judge, file: files[0] };
}

function flyExample() {
  clearPage([], null);
  $("file").value = "";
  for (const point of document.querySelectorAll("#flight circle, #flight .covered")) point.remove();
  largest = { measured: 0, corrected: null };
  $("flight").hidden = false;
  showStatus("Starting", 0);
  $("flight").scrollIntoView({ block: "nearest" });
  send({ fly: { seed: $("seed").valueAsNumber } });
}

function appendShape(picture, name, attributes) {
  const shape = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) shape.setAttribute(key, value);
  picture.append(shape);
}

// Shows one step of the example flight per animation frame, or all at once if the browser prefers reduced motion.
function playSteps() {
  const isStill = matchMedia("(prefers-reduced-motion: reduce)").matches;
  for (const step of steps.splice(0, isStill ? steps.length : 1)) showStep(step);
  if (steps.length) requestAnimationFrame(playSteps);
  else if (judged) showReport();
}

// Microtesla and degrees in units of the pictures.
const SCALE = { field: 1.5, error: 2 };
const SECTOR_DEG = 15;
const RINGS = [["right", 1, 92], ["left", -1, 84]];
// A bank that makes a turn of the calibration, degrees.
const TURN_DEG = 10;

// Marks the heading as covered by a turn: an arc of a ring.
function markCoveredHeading({ heading_deg: heading, roll_deg: roll }) {
  for (const [side, sign, radius] of RINGS) {
    const sector = Math.floor(heading / SECTOR_DEG);
    const id = `${side}-${sector}`;
    if (roll * sign < TURN_DEG || $(id)) continue;
    const [from, to] = [sector, sector + 0.9].map((at) => {
      const angle = (at * SECTOR_DEG * Math.PI) / 180;
      return `${(radius * Math.sin(angle)).toFixed(1)} ${(-radius * Math.cos(angle)).toFixed(1)}`;
    });
    appendShape($("circles"), "path", { id, class: "covered", d: `M${from}A${radius} ${radius} 0 0 1 ${to}` });
  }
}

// Adds a step of the flight to the pictures.
function showStep(step) {
  showStatus(`In flight: ${step.stage}`, step.done);
  markCoveredHeading(step);
  const points = { measured: [step.measured_ut, step.before_deg], corrected: [step.corrected_ut, step.after_deg] };
  for (const [kind, [field, error]] of Object.entries(points)) {
    if (field === null) continue;
    const [forward, right] = field.map((component) => SCALE.field * component);
    appendShape($("circles"), "circle", { class: kind, cx: right.toFixed(1), cy: (-forward).toFixed(1), r: 1.2 });
    appendShape($("errors"), "circle", { class: kind, cx: step.heading_deg.toFixed(1), cy: (-SCALE.error * error).toFixed(2), r: 1.5 });
    largest[kind] = Math.max(largest[kind], Math.abs(error));
  }
  const after = largest.corrected === null ? "" : `, with it ${largest.corrected.toFixed(2)} deg`;
  $("largest").textContent = `without calibration ${largest.measured.toFixed(1)} deg${after}`;
}

// Judges the log with the form's options; if the worker is busy, after its present request.
function judgeAgain() {
  if (!form.reportValidity()) return;
  const request = $("unit").hidden ? { judge: choices() } : requestOf(form.elements.unit.value, choices());
  if (isBusy) next = request;
  else send(request);
}

// The charts' button for a dragged range.
window.judgePart = (from, to) => {
  [form.elements.from_s.value, form.elements.to_s.value] = [from.toFixed(1), to.toFixed(1)];
  judgeAgain();
};

// Shows a status text and the progress `done`: a fraction, undefined if unknown, null to hide the progress bar.
function showStatus(text, done) {
  if (status.textContent !== text) status.textContent = text;
  progress.hidden = done === null;
  if (typeof done === "number") progress.value = done;
  else progress.removeAttribute("value");
}

// Buttons for logs of which one is judged at a time: chosen files, or logs within one.
function showLogs(names) {
  const chosen = files;
  const buttons = names.map((name) => {
    const button = Object.assign(document.createElement("button"), { type: "button", className: "quiet", textContent: name });
    button.onclick = () => (chosen.length > 1 ? openLog(chosen.filter((file) => file.name === name)) : openLog(chosen, name));
    return button;
  });
  $("logs").replaceChildren(...buttons);
  $("logs").hidden = !names.length;
}

// Shows an error in place of the result, and the logs to choose from.
function showFailure(text, names = []) {
  showLogs(names);
  [isBusy, next, judged] = [false, null, null];
  report.removeAttribute("aria-busy");
  report.replaceChildren();
  showStatus("", null);
  $("error").textContent = text;
  $("error").hidden = false;
  $("error").scrollIntoView({ block: "nearest" });
}

function handleMessage(message) {
  if (message.step) return showStatus(message.step, message.done);
  if (message.flight) return steps.push(message.flight) === 1 && requestAnimationFrame(playSteps);
  if (message.summary) return showChoices(message.summary);
  if (message.isFault) startWorker();
  if (message.error !== undefined) return showFailure(message.isFault ? `the program failed (${message.error}); please report it` : message.error, message.logs);
  isBusy = false;
  judged = message.judged;
  if (next) return send(next), (next = null);
  return steps.length || showReport();
}

function showChoices({ compasses, range_s: [from, to], is_table: isTable }) {
  const select = form.elements.compass;
  const chosen = select.value;
  select.replaceChildren(new Option("all", ""), ...compasses.map((number) => new Option(number, number)));
  if (compasses.includes(Number(chosen))) select.value = chosen;
  $("unit").hidden = !isTable;
  [form.elements.from_s.placeholder, form.elements.to_s.placeholder] = [from, to].map((end) => end.toFixed(1));
}

const pause = () => new Promise((resolve) => setTimeout(resolve));

// Shows the report inside this page, one section at a time, so that the browser responds to input in between.
async function showReport() {
  const showing = judged;
  const page = new DOMParser().parseFromString(judged.page, "text/html");
  $("title").textContent = page.querySelector("h1").textContent;
  document.title = page.title;
  const style = page.querySelector("style");
  style.id = "report-style";
  $("report-style")?.remove();
  document.head.append(style);
  report.replaceChildren();
  $("error").hidden = true;
  $("drop").classList.add("small");
  $("intro").hidden = true;
  $("again").after($("examples"));
  for (const section of page.querySelectorAll("main > section")) {
    await pause();
    if (judged !== showing) return;
    report.append(section);
  }
  // The report's own script: the charts, and the button that copies the parameters.
  const script = document.createElement("script");
  script.textContent = page.querySelector("body > script").textContent;
  report.append(script);
  report.removeAttribute("aria-busy");
  $("again").hidden = false;
  form.hidden = isFlight();
  if (!isFlight()) scrollTo(0, 0);
  showStatus(isFlight() ? "Landed. The report of the flight follows the pictures." : "", null);
}

const isFlight = () => !$("flight").hidden;

function downloadFile(name, type, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 60000);
}

$("file").addEventListener("change", ({ target }) => target.files.length && openLog([...target.files]));
form.addEventListener("submit", (event) => (event.preventDefault(), judgeAgain()));
$("save-page").addEventListener("click", () => downloadFile(`${logName()}.html`, "text/html", judged.page));
$("save-json").addEventListener("click", () => downloadFile(`${logName()}.json`, "application/json", `${judged.json}\n`));
$("example-log").addEventListener("click", () => (($("file").value = ""), openLog([])));
$("flight-form").addEventListener("submit", (event) => (event.preventDefault(), flyExample()));

addEventListener("dragover", (event) => {
  event.preventDefault();
  $("drop").classList.add("over");
});
addEventListener("dragleave", () => $("drop").classList.remove("over"));
addEventListener("drop", (event) => {
  event.preventDefault();
  $("drop").classList.remove("over");
  const { files: dropped } = event.dataTransfer;
  if (!dropped.length) return;
  $("file").files = dropped;
  openLog([...dropped]);
});
startWorker();
