/** The page around the scene: follows the state, and sends what its buttons and keys ask for. */

import { call, followState } from "./api.js";
import { hideBanner, showBanner } from "./banners.js";
import { showEstop, stop } from "./estop.js";
import { showForces } from "./readout.js";
import { bindShortcuts, toggleHelp } from "./shortcuts.js";
import { showLimits, showLink, showMode, showState } from "./status_bar.js";
import { reporting } from "./toast.js";

const RATE_HZ = 10;
const DEAD = "CONTROL_PROCESS_DEAD";

const pauseButton = document.getElementById("pause");
const resetButton = document.getElementById("reset");
const panelButton = document.getElementById("panel");
const viser = document.getElementById("viser");

let latest = null;
let halted = false;

function onState(state) {
  // A paused simulation may report a fault instead; its clock tells.
  halted = state.mode === "paused" || state.time_s === latest?.time_s;
  latest = state;
  showState(state);
  showForces(state);
  showEstop(state.mode === "estop", state.message, state.drive ? "Press again: the drives stay damped" : "Press again: the robot stands up");
  const label = halted ? "Resume" : "Pause";
  if (pauseButton.textContent !== label) pauseButton.textContent = label;
  pauseButton.setAttribute("aria-pressed", String(halted));
  const dead = state.faults.includes(DEAD);
  showFaults(state, dead);
  showDead(state, dead);
}

function showDead(state, dead) {
  pauseButton.disabled = resetButton.disabled = dead || state.drive !== null;
  if (!dead) return hideBanner("control");
  showMode("stopped");
  showForces(null);
  showBanner("control", "stop", state.message, {
    label: "Restart control",
    act: () => reporting(() => call("POST", "control/restart", {})),
  });
}

/** Faults that damp get a banner; limits that come and go are told in the status bar, which does not move the scene. */
function showFaults(state, dead) {
  if (state.mode === "fault" && !dead) showBanner("fault", "warn", state.message);
  else hideBanner("fault");
  showLimits(state.mode === "running" ? [...(state.drive?.faults ?? []), ...Object.values(state.fault_words)] : []);
}

function onLink(link) {
  showLink(link);
  if (link === "lost") showBanner("link", "warn", "The server does not answer. The robot may still be moving. Trying again.");
  else hideBanner("link");
}

const pauseOrResume = () =>
  reporting(() => call("POST", "run", { state: halted ? "running" : "paused" }));
const reset = () => reporting(() => call("POST", "reset", {}));
const step = () => reporting(() => call("POST", "step", { ticks: 10 }));
const toggleGuidance = () => reporting(() => call("PATCH", "command", { guidance: !latest?.command.guidance }));

/** On a phone the panel is a drawer of the scene's page. */
function togglePanel() {
  const open = viser.contentDocument.documentElement.classList.toggle("forcelens-panel-open");
  panelButton.setAttribute("aria-pressed", String(open));
}

/** Hand a key to the scene's page, where Viser listens for it. */
function toScene(key) {
  const options = { key, code: `Digit${key}`, bubbles: true };
  viser.contentDocument.body.dispatchEvent(new KeyboardEvent("keydown", options));
  viser.contentDocument.body.dispatchEvent(new KeyboardEvent("keyup", options));
}

pauseButton.onclick = pauseOrResume;
panelButton.onclick = togglePanel;
resetButton.onclick = reset;
document.getElementById("help").onclick = toggleHelp;

bindShortcuts([
  { keys: ["E", "Escape"], label: "E Esc", words: "E-stop", act: stop },
  { keys: [" "], label: "Space", words: "Pause and resume", act: pauseOrResume },
  { keys: ["."], label: ".", words: "While paused: advance 20 ms", act: step },
  { keys: ["R"], label: "R", words: "Reset the simulation", act: reset },
  { keys: ["G"], label: "G", words: "Zero-force guidance on and off", act: toggleGuidance },
  ...["corner", "front", "side", "top", "hand"].map((view, index) => {
    const key = String(index + 1);
    return { keys: [key], label: key, words: `Camera: ${view}`, act: () => toScene(key) };
  }),
  { keys: ["?"], label: "?", words: "This help", act: toggleHelp },
]);

followState(RATE_HZ, onState, onLink);
