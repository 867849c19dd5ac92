/** The page around the scene: follows the state, and sends what its buttons and keys ask for. */

import { call } from "./api.js";
import { hideBanner, showBanner } from "./banners.js";
import { showEstop, stop } from "./estop.js";
import { rumble } from "./gamepad.js";
import { keepLease } from "./lease.js";
import { watchLink } from "./link.js";
import { followPilot } from "./pilot.js";
import { showForces } from "./readout.js";
import { bindShortcuts, toggleHelp } from "./shortcuts.js";
import "./sticks.js";
import { showLimits, showLink, showMode, showState } from "./status_bar.js";
import { reporting } from "./toast.js";

const RATE_HZ = 10;
const DEAD = "CONTROL_PROCESS_DEAD";
const SILENT = "CONTROL_PROCESS_SILENT";

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
  keepLease();
  followPilot(state);
  rumble(state);
  showState(state);
  showForces(state);
  showEstop(state.mode === "estop", state.message, state.drive ? "Press again: the drives stay damped" : "Press again: the robot stands up");
  const label = halted ? "Resume" : "Pause";
  if (pauseButton.textContent !== label) pauseButton.textContent = label;
  pauseButton.setAttribute("aria-pressed", String(halted));
  showFaults(state);
  showFailure(state);
  showSilence(state);
}

/** The control process has died or hangs: what the page shows is old. */
function showSilence({ faults, message, stale_s: stale }) {
  const dead = faults.includes(DEAD);
  const silent = dead || faults.includes(SILENT);
  pauseButton.disabled = resetButton.disabled = silent || latest.drive !== null;
  if (!silent) return hideBanner("control");
  showMode(dead ? "stopped" : "silent");
  showForces(null);
  showBanner("control", "stop", `${message} It has been so for ${Math.round(stale)} s.`, {
    label: "Restart control",
    act: () => reporting(() => call("POST", "control/restart", { force: !dead })),
  });
}

/** The backend steps no more: time stands still until the cure. */
function showFailure({ failure, drive }) {
  if (!failure) return hideBanner("failure");
  const cure = drive ? undefined : { label: "Reset the simulation", act: reset };
  showBanner("failure", "stop", `Stopped: ${failure}.`, cure);
}

/** Faults that damp get a banner; limits that come and go are told in the status bar, which does not move the scene. */
function showFaults(state) {
  const toldApart = state.failure || state.faults.includes(DEAD) || state.faults.includes(SILENT);
  if (state.mode === "fault" && !toldApart) showBanner("fault", "warn", state.message);
  else hideBanner("fault");
  showLimits(state.mode === "running" ? [...(state.drive?.faults ?? []), ...Object.values(state.fault_words)] : []);
}

function onLink(link, reason) {
  showLink(link);
  if (link === "refused") showBanner("link", "stop", `This page cannot stop the robot: ${reason}`);
  else if (link === "lost") showBanner("link", "warn", reason ?? "The server does not answer. The robot may still be moving. Trying again.");
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

/** Hand a digit to the scene's page, where Viser listens for it. */
function toScene(key) {
  for (const type of ["keydown", "keyup"]) {
    const event = new KeyboardEvent(type, { key, code: `Digit${key}`, bubbles: true });
    event.forcelensRelayed = true; // and viser_bridge.js does not hand it back
    viser.contentDocument.body.dispatchEvent(event);
  }
}

pauseButton.onclick = pauseOrResume;
panelButton.onclick = togglePanel;
resetButton.onclick = reset;
document.getElementById("help").onclick = toggleHelp;

bindShortcuts([
  { places: ["Escape", "KeyE"], prints: "E", label: "Esc E", words: "E-stop", act: stop },
  { places: ["Space"], label: "Space", words: "Pause and resume", act: pauseOrResume },
  { places: ["Period"], label: ".", words: "While paused: advance 20 ms", act: step },
  { places: ["KeyR"], label: "R", words: "Reset the simulation", act: reset },
  { places: ["KeyG"], label: "G", words: "Zero-force guidance on and off", act: toggleGuidance },
  ...["corner", "front", "side", "top", "hand"].map((view, index) => {
    const key = String(index + 1);
    return { places: [`Digit${key}`], label: key, words: `Camera: ${view}`, act: () => toScene(key) };
  }),
  { places: ["Shift+Slash"], prints: "?", label: "?", words: "This help", act: toggleHelp },
]);

watchLink(RATE_HZ, onState, onLink);
