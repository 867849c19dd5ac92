/**
 * A gamepad, by the browser's standard mapping: hold a shoulder button to drive, B stops, and it shakes as the hand is pushed.
 *
 * Left stick: base ahead, back, and turn. Right stick: hand ahead and sideways. Triggers: hand up (right) and down (left).
 */

import { stop } from "./estop.js";
import { pilot, piloted } from "./pilot.js";
import { toast } from "./toast.js";

const PERIOD_MS = 25;
const DEAD_ZONE = 0.12;
const DEAD_MAN = [4, 5];
const ESTOP = 1;
const DOWN = 6;
const UP = 7;
const FELT_FROM_N = 2;
const FELT_FULL_N = 30;
const RUMBLE_MS = 180;

let held = false;
let stopPressed = false;
let rumbled = 0;

/** A deflection without the play around the middle, -1 to 1. */
function deflection(value = 0) {
  const beyond = Math.abs(value) - DEAD_ZONE;
  return beyond > 0 ? (Math.sign(value) * Math.min(beyond, 1 - DEAD_ZONE)) / (1 - DEAD_ZONE) : 0;
}

const pressed = (pad, button) => pad.buttons[button]?.pressed ?? false;

function connectedPad() {
  const pads = [...(navigator.getGamepads?.() ?? [])].filter((pad) => pad?.connected && pad.mapping === "standard");
  return pads.find((pad) => DEAD_MAN.some((button) => pressed(pad, button))) ?? pads[0];
}

function poll() {
  const pad = document.hidden ? undefined : connectedPad();
  const stopping = pad !== undefined && pressed(pad, ESTOP);
  if (stopping && !stopPressed) stop();
  stopPressed = stopping;
  const holds = pad !== undefined && !stopping && DEAD_MAN.some((button) => pressed(pad, button));
  if (!holds) {
    if (held) pilot(null);
    held = false;
    return;
  }
  held = true;
  const [turn, back, right, down] = pad.axes.map(deflection);
  const lift = (pad.buttons[UP]?.value ?? 0) - (pad.buttons[DOWN]?.value ?? 0);
  // Subtracted from 0, so that a stick at rest is 0 and not -0.
  pilot({ base: [0 - back, 0, 0 - turn], hand: [0 - down, 0 - right, deflection(lift)] });
}

/** Call with every state: while the dead-man is held, the pad shakes as hard as the hand is pushed, by the robot's own estimate. */
export function rumble(state) {
  const force = state.end_effector.force_estimated_n;
  const actuator = held && piloted() ? connectedPad()?.vibrationActuator : undefined;
  if (!force || !actuator || performance.now() - rumbled < RUMBLE_MS / 2) return;
  rumbled = performance.now();
  const felt = Math.min(Math.max((Math.hypot(...force) - FELT_FROM_N) / (FELT_FULL_N - FELT_FROM_N), 0), 1);
  actuator.playEffect("dual-rumble", { duration: RUMBLE_MS, strongMagnitude: felt, weakMagnitude: Math.sqrt(felt) })?.catch?.(() => {});
}

window.addEventListener("gamepadconnected", (event) => {
  const usable = event.gamepad.mapping === "standard";
  toast(usable ? "Gamepad: hold LB or RB to drive. B is the e-stop." : "This gamepad's buttons are not known to the browser.");
});
// A page that is hidden hears no gamepad: what was held counts as let go.
document.addEventListener("visibilitychange", poll);
setInterval(poll, PERIOD_MS);
