/** The facts of the status bar, as the control process reports them. */

const MODE_WORDS = { running: "Running", guidance: "Guidance", paused: "Paused", estop: "E-stop", fault: "Fault", stopped: "Stopped", silent: "No answer",
  disconnected: "No robot", observe: "Observing", damped: "Damped", standing_up: "Standing up", ready: "Ready", sitting: "Sitting down" };
const LINK_WORDS = { live: "live", connecting: "connecting", lost: "lost, retrying", refused: "not permitted" };

const element = (id) => document.getElementById(id);

function show(id, text, level = "") {
  const target = element(id);
  if (target.textContent !== text) target.textContent = text;
  if ((target.dataset.level ?? "") !== level) target.dataset.level = level;
}

/** Show a state of the stream. */
export function showState(state) {
  const paused = state.mode === "paused";
  const { real_time_factor: factor, speed, overruns, overruns_last_minute: perMinute, overrun_share: share } = state.loop;
  const { lateness_p99_ms: lateness, realtime_scheduling: realtime } = state.loop;
  showMode(modeOf(state));
  const drive = state.drive;
  show("backend", drive ? `${state.backend}${drive.dry_run ? ", dry run" : ""}: ${drive.state.replace("_", " ")}` : `${state.backend}, ${state.scene}`);
  show("real-time", paused ? "–" : `× ${factor.toFixed(2)}`, !paused && factor < SLOW * speed ? "warn" : "");
  show("overruns", `${perMinute} / min`, state.faults.includes(OVERRUNS) ? "warn" : "");
  element("overruns").title =
    `Ticks that missed their 2 ms deadline in the last minute; ${(100 * share).toFixed(1)} % of the last seconds', ${overruns} since the start. ` +
    `99 % are at most ${lateness.toFixed(2)} ms late; real-time priority is ${realtime ? "granted" : "not granted"}.`;
  const doubts = state.estimator_flags.map((flag) => DOUBTS[flag] ?? flag);
  show("estimator", [state.estimator, ...doubts].join(", "), doubts.length ? "warn" : "");
  showRecording(state.recording);
}

function showRecording(recording) {
  element("recording").parentElement.hidden = !recording;
  if (!recording) return;
  const seconds = Math.floor(recording.duration_s);
  const time = `${Math.floor(seconds / 60)}:${String(seconds % 60).padStart(2, "0")}`;
  show("recording", `${time}, ${(recording.size_bytes / 1e6).toFixed(1)} MB`);
}

/** Of a robot that is not in the controller's hands, its drives tell more than the loop. */
function modeOf(state) {
  if (state.mode !== "running") return state.mode;
  if (state.drive && state.drive.state !== "policy") return state.drive.state;
  return state.command.guidance ? "guidance" : "running";
}

/** Why the force may be off by more than its standard deviation says, in a word. */
const DOUBTS = { JOINT_AT_STOP: "joint at its end", SELF_CONTACT: "arm on robot", CONTACT_ELSEWHERE: "touched elsewhere", MASS_ADAPTING: "adapting" };

const SLOW = 0.9;
const OVERRUNS = "LOOP_OVERRUNS";

/** Show the mode alone: a key of MODE_WORDS. */
export function showMode(mode) {
  const pill = element("mode");
  if (pill.dataset.mode === mode) return;
  pill.dataset.mode = mode;
  pill.textContent = MODE_WORDS[mode] ?? mode;
}

/** Show the state of the link to the server: a key of LINK_WORDS. */
export function showLink(link) {
  const target = element("connection");
  if (target.dataset.state === link) return;
  target.dataset.state = link;
  target.textContent = LINK_WORDS[link];
}

const LIMITS_MS = 2000;
let limitsTimer = 0;

/** Show what limits the robot right now, in words, and keep it readable for a moment when it passes. */
export function showLimits(words) {
  if (words.length === 0) return;
  show("limits", words.join(", "), "warn");
  element("limits").title = words.join("\n");
  element("limits").parentElement.hidden = false;
  clearTimeout(limitsTimer);
  limitsTimer = setTimeout(() => (element("limits").parentElement.hidden = true), LIMITS_MS);
}
