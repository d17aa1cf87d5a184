"use strict";
// Shows what the server tells and asks it to stop; it can do nothing else. Nothing here is fetched
// from anywhere but the address that the page came from.

const $ = (id) => document.getElementById(id);
const SPAN_S = 30, SILENT_S = 0.9, GAIN = 4, STOP_TIMEOUT_MS = 1500, DIFFERENCE_MS = 250;
const PHASES = {
  "preflight": "checking all devices", "air-press": "test press in the air above the gel",
  "home": "moving to the home position", "tare": "taring the force sensor",
  "reference": "recording the no-contact image", "approach": "approaching the gel",
  "search": "searching for contact", "press": "pressing to the target",
  "dwell": "holding the force, recording images", "retract": "retracting from the gel",
  "drift-check": "checking the force sensor's drift", "verdict": "judging", "fault": "making the arm safe",
  "sway": "going up and down a little to measure delays",
  "stopped": "the arm has stopped; finishing the record", "closing": "finishing the record",
  "ended": "the run has ended", "": "waiting for the run",
};
let setup = null, run = null, live = null, heardMs = performance.now(), stopped = false;
let trace = [], depthM = 0, referenceOf = null, reference = null;
const picturesShown = {};
let colours = {}, differedMs = 0;

// ---- what the server tells -------------------------------------------------------------------

function listen() {
  const events = new EventSource("events");
  const on = (name, take) => events.addEventListener(name, (event) => {
    heardMs = performance.now();
    take(JSON.parse(event.data));
  });
  on("setup", (told) => { setup = told; trace = []; showSetup(); });
  on("run", (told) => { run = told; showRun(); });
  on("live", (told) => { live = told; showLive(); });
  events.onerror = () => {
    if (run && run.ended) {
      events.close();  // the server has ended with the run
    } else if (events.readyState === EventSource.CLOSED) {
      setTimeout(listen, 1000);  // refused: too many pages watch
    }
  };
}

function showSetup() {
  $("run").textContent = `${setup.run} · ${setup.sensor}`;
  $("simulated").hidden = !setup.simulated;
  $("outline-key").hidden = !setup.outline;
}

function showRun() {
  const phase = run.phase;
  $("phase").textContent = run.ended ? ending() : PHASES[phase] || phase;
  document.title = `${run.trial ? `${run.trial}/${setup.targets_n.length} ` : ""}${run.ended ? run.outcome : phase}`;
  $("trial").textContent = run.trial
    ? `trial ${run.trial} of ${setup.targets_n.length}${run.attempt > 1 ? `, attempt ${run.attempt}` : ""}`
    : `${setup.targets_n.length} trials`;
  $("target").textContent = run.target_n === null ? "" :
    `of ${run.target_n.toFixed(4)} ± ${setup.tolerance_n} N, limit ${setup.soft_force_n} N`;
  const free = run.disk.free_bytes ? `${(run.disk.free_bytes / 1e9).toFixed(1)} GB free on the run's disk` : "";
  $("host").textContent = free;
  showTrials();
  showChecks();
  $("stop").disabled = run.ended;
  $("journal").replaceChildren(...run.journal.slice().reverse().map(journalLine));
  if (run.ended) {
    sayEnding();
  } else if (run.reason) {
    say(run.reason, "");
  }
}

// What the terminal says, too: a recorded run is judged by its report, not by its trials.
function ending() {
  const words = { analysing: "recording complete, analysing", failed: "recording complete, not analysed" };
  const state = run.afterwards.state;
  if (state === "reported") return `report: ${run.afterwards.passed ? "passed" : "not passed"}`;
  if (state) return words[state];
  return ["passed", "failed"].includes(run.outcome)
    ? `recording complete: all trials ${run.outcome === "passed" ? "passed" : "done, some failed"}`
    : `the run has ended: ${run.outcome}`;
}

function sayEnding() {
  const after = run.afterwards;
  if (!after.state) {
    say(run.reason || "All planned trials are done.", run.outcome === "passed" ? "good" : "");
    return;
  }
  say(after.text, after.state === "analysing" ? "plain" : after.passed ? "good" : "");
  if (after.state === "reported") {
    const link = part("a", "open the report");
    link.href = "report";
    link.target = "_blank";
    $("alert").append(" ", link);
  }
}

function showTrials() {
  $("trials").replaceChildren(...run.trials.map((trial) => {
    const figure = document.createElement("figure");
    figure.classList.toggle("now", trial.index === run.trial && !run.ended);
    figure.append(trial.has_picture ? thumbnail(trial) : part("div", "", "none"));
    const caption = part("figcaption", `${trial.index}: target ${trial.target_n.toFixed(4)} N`);
    if (trial.outcome) {
      caption.append(document.createElement("br"), part("span", trial.outcome, trial.outcome));
    }
    if (trial.force_n !== undefined && trial.force_n !== null) {
      const depth = trial.depth_m === null ? "" : `, ${(trial.depth_m * 1e3).toFixed(3)} mm`;
      caption.append(document.createElement("br"), `${trial.force_n.toFixed(4)} N${depth}`);
    }
    figure.append(caption);
    return figure;
  }));
}

function thumbnail(trial) {
  const image = document.createElement("img");
  image.alt = `camera image held at trial ${trial.index}`;
  image.src = `picture/trial-${trial.index}?${trial.outcome || run.phase}`;
  return image;
}

function showChecks() {
  const judged = run.trials.filter((trial) => trial.checks && trial.checks.length).pop();
  $("checks-of").textContent = judged ? `of trial ${judged.index}` : "";
  const rows = judged ? judged.checks.map((check) => row([
    `${check.passed ? "✓" : "✗"} ${check.name.replaceAll("_", " ")}`,
    `${Number(check.measured.toPrecision(4))} ${check.unit}`, check.limit.replace("<=", "≤").replace(">=", "≥"),
  ], check.passed ? "" : "failed")) : [row(["none yet: each verdict adds some"])];
  $("checks").tBodies[0].replaceChildren(...rows);
}

function journalLine(event) {
  const line = document.createElement("li");
  const ago = live ? `${Math.max(0, live.now_s - event.stamp_s).toFixed(0)} s ago` : "";
  const detail = Object.entries(event.detail)
    .filter(([, value]) => value !== "" && (typeof value !== "object" || Array.isArray(value)))
    .map(([name, value]) => (name === event.name ? value : quantity(name, value))).join(", ");
  line.append(part("time", ago.padEnd(10)), ` ${event.trial ? `trial ${event.trial} ` : ""}${event.name} ${detail}`.slice(0, 300));
  line.firstChild.dataset.stamp = event.stamp_s;
  return line;
}

function showLive() {
  if (live.from_start) trace = [];
  trace.push(...live.trace);
  while (trace.length && trace[0][0] < live.now_s - SPAN_S) trace.shift();
  const streams = live.streams, force = streams.force, arm = streams.arm;
  if (force) showForce(force.numbers);
  if (arm) showArm(arm.numbers);
  $("left").textContent = live.left_s === null || (run && run.ended) ? "" : `· ${clock(live.left_s)} left`;
  $("streams").tBodies[0].replaceChildren(...Object.entries(streams).map(([name, stream]) => {
    const line = row([name, stream.rate_hz.toFixed(1), stream.lost, age(stream.age_s)]);
    line.dataset.stream = name;
    return line;
  }));
  if (live.dropped) $("host").dataset.dropped = live.dropped;
  for (const time of $("journal").querySelectorAll("time")) {
    time.textContent = `${Math.max(0, live.now_s - time.dataset.stamp).toFixed(0)} s ago`.padEnd(10);
  }
  for (const [name, stream] of Object.entries(streams)) {
    if (stream.picture && picturesShown[name] !== stream.picture) fetchPicture(name, stream);
    if (name.startsWith("twin")) showTwin(name, stream);
  }
  if (run && run.has_reference && referenceOf !== run.trial) fetchReference();
  drawTrace();
  showAges();
}

function showForce(numbers) {
  if (!numbers.is_tared) {
    $("force").textContent = "–";
    $("axes").tBodies[0].replaceChildren(row(["not tared yet"]));
    return;
  }
  const newest = numbers.force_n[numbers.force_n.length - 1];
  $("force").textContent = newest.toFixed(3);
  const most = setup.soft_force_n;
  $("bar").style.width = `${Math.min(100, Math.max(0, 100 * newest / most))}%`;
  const target = run && run.target_n;
  $("bar-target").hidden = !target;
  if (target) $("bar-target").style.left = `${100 * target / most}%`;
  const names = ["Fx", "Fy", "Fz", "Mx", "My", "Mz"];
  $("axes").tBodies[0].replaceChildren(...numbers.wrench.map((value, axis) =>
    row([names[axis], axis < 3 ? `${value.toFixed(4)} N` : `${(value * 1e3).toFixed(2)} N mm`])));
}

function showArm(numbers) {
  const mm = (value) => `${(value * 1e3).toFixed(3)} mm`;
  const speed = Math.hypot(...numbers.velocity.slice(0, 3));
  const rows = [..."xyz"].map((axis, place) => row([axis, mm(numbers.position_m[place])]));
  rows.push(row(["speed", `${(speed * 1e3).toFixed(3)} mm/s`]));
  const contact = contactHeight();
  depthM = contact === null ? 0 : Math.max(0, contact - numbers.position_m[2]);
  rows.push(row(["below contact", contact === null ? "–" : mm(depthM)]));
  rows.push(row(["turned", numbers.rotation_rad.map((angle) => `${(angle * 180 / Math.PI).toFixed(1)}°`).join(" ")]));
  $("arm").tBodies[0].replaceChildren(...rows);
}

function contactHeight() {
  if (!run || !["press", "dwell", "retract"].includes(run.phase)) return null;
  const found = run.journal.filter((event) => event.detail.contact_z_m !== undefined).pop();
  return found ? found.detail.contact_z_m : null;
}

// ---- ages: greyed out here, by this browser's clock, whatever the server does ------------------

function showAges() {
  const sinceS = (performance.now() - heardMs) * 1e-3;
  const over = run && ["stopped", "closing", "ended"].includes(run.phase);
  const silent = !(run && run.ended) && sinceS > SILENT_S;
  for (const card of document.querySelectorAll("[data-stream]")) {
    const stream = live && live.streams[card.dataset.stream];
    const limit = (setup && setup.stale_s[card.dataset.stream]) || 1.0;
    const ageS = stream && stream.age_s !== null ? stream.age_s + sinceS : null;
    const stale = !over && ageS !== null && ageS > limit;
    card.classList.toggle("is-stale", stale);
    const mark = card.querySelector(".stale");
    if (mark) {
      mark.hidden = !stale;
      mark.textContent = stale ? `STALE: no new data for ${ageS.toFixed(1)} s` : "";
    } else if (stale && card.lastChild) {
      card.lastChild.textContent = `${ageS.toFixed(1)} s STALE`;
    }
  }
  const dropped = $("host").dataset.dropped;
  if (run && dropped) $("host").textContent = `${(run.disk.free_bytes / 1e9).toFixed(1)} GB free on the run's disk; this page was too slow and missed ${dropped} messages`;
  if (silent && !stopped) {
    say(`No message for ${sinceS.toFixed(1)} s: all values on this page are old. The run may still be active; any key in the terminal stops it.`, "plain", true);
  } else if ($("alert").dataset.silent) {
    $("alert").hidden = true;
    delete $("alert").dataset.silent;
    if (run) showRun();
  }
}

// ---- pictures ---------------------------------------------------------------------------------

async function fetchPicture(name, stream) {
  if (picturesShown[`busy ${name}`]) return;  // one at a time: a slow line gets fewer, not older ones
  picturesShown[`busy ${name}`] = true;
  picturesShown[name] = stream.picture;
  try {
    const answer = await fetch(`picture/${encodeURIComponent(name)}`);
    if (answer.ok) await drawPicture(name, await answer.blob());
  } catch { /* the ages tell */ } finally {
    picturesShown[`busy ${name}`] = false;
  }
}

async function drawPicture(name, blob) {
  const bitmap = await createImageBitmap(blob);
  if (name !== "camera") {
    const canvas = document.querySelector(`[data-stream="${CSS.escape(name)}"] canvas`);
    if (canvas) paint(canvas, bitmap);
    return;
  }
  paint($("image"), bitmap);
  drawOutline($("image"));
  drawDifference(bitmap);
}

function paint(canvas, bitmap) {
  if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
    canvas.width = bitmap.width;
    canvas.height = bitmap.height;
    canvas.style.aspectRatio = `${bitmap.width} / ${bitmap.height}`;
  }
  canvas.getContext("2d").drawImage(bitmap, 0, 0);
}

function drawOutline(canvas) {
  const outline = setup && setup.outline;
  if (!outline) return;
  const ball = outline.ball_radius_m;
  // Of a ball: the circle at which it lies in the plane that it has reached.
  const radius = ball ? Math.sqrt(Math.max(0, depthM * (2 * ball - depthM))) : outline.flat_radius_m;
  const shrink = canvas.width / outline.image_size_px[0];
  const context = canvas.getContext("2d");
  context.beginPath();
  context.ellipse((outline.centre_px[0] + 0.5) * shrink, (outline.centre_px[1] + 0.5) * shrink,
    radius * outline.scale_px_m[0] * shrink, radius * outline.scale_px_m[1] * shrink, 0, 0, 2 * Math.PI);
  context.setLineDash([8, 6]);
  context.lineWidth = Math.max(2, canvas.width / 320);
  context.strokeStyle = colour("--outline");
  context.stroke();
  context.setLineDash([]);
}

const SMALL = document.createElement("canvas");
SMALL.width = 320;

function pixels(bitmap) {
  SMALL.height = Math.round(SMALL.width * bitmap.height / bitmap.width);
  const context = SMALL.getContext("2d", { willReadFrequently: true });
  context.drawImage(bitmap, 0, 0, SMALL.width, SMALL.height);
  return context.getImageData(0, 0, SMALL.width, SMALL.height);
}

async function fetchReference() {
  if (run.phase === "reference") return;  // its last frame is still to come
  referenceOf = run.trial;
  try {
    const answer = await fetch("picture/reference");
    if (answer.ok) reference = pixels(await createImageBitmap(await answer.blob()));
  } catch { referenceOf = null; }
}

function drawDifference(bitmap) {
  if (!reference || performance.now() - differedMs < DIFFERENCE_MS) return;
  differedMs = performance.now();
  const now = pixels(bitmap), before = reference.data;
  if (before.length !== now.data.length) return;
  for (let place = 0; place < now.data.length; place++) {
    if (place % 4 !== 3) now.data[place] = 128 + GAIN * (now.data[place] - before[place]);
  }
  const canvas = $("difference");
  canvas.width = now.width;
  canvas.height = now.height;
  canvas.getContext("2d").putImageData(now, 0, 0);
  $("difference-note").textContent = `grey: no difference; amplified ${GAIN} times; relative to the last frame before trial ${referenceOf}`;
}

// ---- the twin, where one is shown --------------------------------------------------------------

function showTwin(name, stream) {
  let card = document.querySelector(`section[data-stream="${CSS.escape(name)}"]`);
  if (!card) {
    card = part("section", "");
    card.dataset.stream = name;
    const heading = part("h2", `${name} `);
    const mark = part("span", "", "stale");
    mark.hidden = true;
    heading.append(mark);
    card.append(heading, document.createElement("canvas"), part("p", "", "legend"));
    $("twins").append(card);
  }
  card.querySelector("canvas").hidden = !stream.picture;
  card.querySelector("p").textContent = Object.entries(stream.numbers)
    .map(([key, value]) => quantity(key, value)).join(" · ");
}

// ---- the trace --------------------------------------------------------------------------------

function drawTrace() {
  const canvas = $("trace"), context = fit(canvas), width = canvas.clientWidth, height = canvas.clientHeight;
  context.clearRect(0, 0, width, height);
  if (!setup) return;
  const target = run && run.target_n, soft = setup.soft_force_n, hard = setup.hard_force_n;
  const highest = Math.max(0.5, 1.25 * (target || 0), 1.1 * Math.max(0, ...trace.map((point) => point[1])));
  const top = highest > 0.8 * soft ? Math.max(highest, 1.08 * soft) : highest;
  const left = 50, bottom = height - 20;
  const x = (seconds) => left + (width - left - 6) * (1 + (seconds - live.now_s) / SPAN_S);
  const y = (newtons) => bottom - (bottom - 8) * (newtons + 0.05 * top) / (1.05 * top);
  context.font = "12px system-ui, sans-serif";
  context.lineWidth = 1;
  const step = niceStep(top / 4);
  for (let newtons = 0; newtons <= top; newtons += step) {
    rule(context, left, width, y(newtons), colour("--line"));
    context.fillStyle = colour("--dim");
    context.textAlign = "right";
    context.fillText(`${Number(newtons.toFixed(3))} N`, left - 6, y(newtons) + 4);
  }
  context.textAlign = "center";
  for (let ago = 0; ago <= SPAN_S; ago += 10) {
    const place = x(live.now_s - ago);
    context.fillText(ago ? `−${ago} s` : "now", Math.min(place, width - 16), height - 5);
  }
  if (target) {
    context.fillStyle = colour("--band");
    context.globalAlpha = 0.25;
    const half = Math.max(1, y(target - setup.tolerance_n) - y(target));
    context.fillRect(left, y(target) - half, width - left, 2 * half);
    context.globalAlpha = 1;
    rule(context, left, width, y(target), colour("--band"));
  }
  context.lineWidth = 2;
  context.setLineDash([7, 5]);
  if (soft <= top) rule(context, left, width, y(soft), colour("--soft"));
  context.setLineDash([]);
  if (hard <= top) rule(context, left, width, y(hard), colour("--hard"));
  context.strokeStyle = colour("--force");
  context.beginPath();
  for (const [seconds, newtons] of trace) if (x(seconds) >= left) context.lineTo(x(seconds), y(newtons));
  context.stroke();
  canvas.dataset.newest = trace.length ? trace[trace.length - 1][0] : "";
}

function fit(canvas) {
  const scale = window.devicePixelRatio || 1;
  const width = Math.round(canvas.clientWidth * scale), height = Math.round(canvas.clientHeight * scale);
  if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
  const context = canvas.getContext("2d");
  context.setTransform(scale, 0, 0, scale, 0, 0);
  return context;
}

function rule(context, from, to, at, style) {
  context.strokeStyle = style;
  context.beginPath();
  context.moveTo(from, at);
  context.lineTo(to, at);
  context.stroke();
}

function niceStep(rough) {
  const power = 10 ** Math.floor(Math.log10(rough));
  return [1, 2, 5, 10].map((factor) => factor * power).find((step) => step >= rough);
}

// ---- stop -------------------------------------------------------------------------------------

async function stop() {
  if (run && run.ended) return;
  stopped = true;
  $("stop").classList.add("asked");
  say("Stop requested…", "plain");
  try {
    const answer = await fetch("stop", { method: "POST", signal: AbortSignal.timeout(STOP_TIMEOUT_MS) });
    if (!answer.ok) throw new Error(`the server answered ${answer.status}`);
    say("Stop requested: the arm stops and slowly leaves the gel. A second stop holds it where it is.", "plain");
  } catch (error) {
    say(`THE STOP REQUEST FAILED (${error.message}). Press a key in the terminal, or the pendant's emergency stop.`, "");
  }
}

$("stop").addEventListener("click", (event) => { event.currentTarget.blur(); stop(); });
document.addEventListener("keydown", (event) => {
  if (event.code !== "Space") return;
  event.preventDefault();  // neither scrolling nor a second click of a button in focus
  if (!event.repeat) stop();
});
document.addEventListener("keyup", (event) => { if (event.code === "Space") event.preventDefault(); });

// ---- small things -----------------------------------------------------------------------------

function say(text, kind, silent = false) {
  const alert = $("alert");
  if (alert.textContent !== text) alert.textContent = text;
  alert.className = kind;
  alert.hidden = false;
  if (silent) alert.dataset.silent = "1"; else delete alert.dataset.silent;
}

function part(name, text, kind = "") {
  const made = document.createElement(name);
  made.textContent = text;
  made.className = kind;
  return made;
}

function row(cells, kind = "") {
  const line = part("tr", "", kind);
  line.append(...cells.map((cell) => part("td", cell)));
  return line;
}

function colour(name) { return colours[name] ??= getComputedStyle(document.documentElement).getPropertyValue(name); }
function age(seconds) { return seconds === null ? "–" : `${(seconds * 1e3).toFixed(0)} ms`; }
// The unit that a name ends with, what it is shown in, and how many of those it is.
const UNITS = [["_m_s", "mm/s", 1e3], ["_nm", "N mm", 1e3], ["_ms", "ms", 1], ["_px", "px", 1],
  ["_rad", "°", 180 / Math.PI], ["_hz", "Hz", 1], ["_m", "mm", 1e3], ["_n", "N", 1], ["_s", "s", 1], ["_relative", "%", 100]];
function quantity(name, value) {
  const found = UNITS.find(([ending]) => name.endsWith(ending));
  const bare = (found ? name.slice(0, -found[0].length) : name).replaceAll("_", " ");
  const numbers = found ? [value].flat() : [];
  if (!numbers.length || !numbers.every((number) => typeof number === "number")) return `${bare} ${short(value)}`;
  const fine = found[1] === "mm" && Math.max(...numbers.map(Math.abs)) < 1e-5;
  const [unit, times] = fine ? ["µm", 1e6] : found.slice(1);
  return `${bare} ${numbers.map((number) => short(number * times)).join(", ")} ${unit}`;
}
function short(value) { return typeof value === "number" ? Number(value.toPrecision(4)) : value; }
function clock(seconds) {
  const whole = Math.round(seconds);
  return whole < 60 ? `${whole} s` : `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s`;
}

matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { colours = {}; });
addEventListener("resize", () => { if (live) drawTrace(); });
setInterval(showAges, 100);
listen();
