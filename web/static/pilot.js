/** What sticks ask for, of a gamepad or on the screen: base velocity and a moving target of the hand, while they are held. */

import { call } from "./api.js";
import { claim } from "./lease.js";
import { toast } from "./toast.js";

const PERIOD_MS = 50;
const STOP_RETRY_MS = 100;
const STOP_ATTEMPTS = 20;
/** Ahead m/s, sideways m/s, turn rad/s, at full stick. */
const BASE_FULL = [0.4, 0.0, 0.4];
/** m/s at full stick. */
const HAND_FULL = 0.15;
/** Box of the hand's target, m, heading: control.command.limits. Reach is limited by the console. */
const HAND_BOX = [[0.3, 0.8], [-0.35, 0.35], [0.1, 0.95]];

let latest = null;
let wish = null;
let hand = null;
let timer = 0;
let moved_ms = 0;
let inFlight = Promise.resolve();

/** Call with every state of the stream. */
export function followPilot(state) {
  latest = state;
}

/**
 * Drive, or let go.
 * @param {{base: number[], hand: number[]} | null} sticks base ahead, left, turn left, and hand x, y, z, each -1 to 1; null: let go
 */
export function pilot(sticks) {
  const held = wish !== null;
  wish = sticks;
  if (sticks && !held) begin();
  else if (!sticks && held) end();
}

/** Whether somebody holds a stick. */
export const piloted = () => wish !== null;

async function begin() {
  hand = [...(latest?.command.position_m ?? [])];
  moved_ms = performance.now();
  try {
    await claim();
  } catch (error) {
    toast(error.message);
    wish = null;
    return;
  }
  clearInterval(timer);
  if (wish) timer = setInterval(send, PERIOD_MS);
}

function end() {
  clearInterval(timer);
  // Once what is on its way has arrived, too: it may ask for motion.
  const sent = inFlight;
  stopBase();
  sent.finally(() => wish ?? stopBase());
}

async function stopBase() {
  for (let attempt = 1; wish === null && attempt <= STOP_ATTEMPTS; attempt += 1) {
    try {
      return await call("PATCH", "command", { base_velocity: [0, 0, 0] }, 1000);
    } catch (error) {
      if (error.status === 409) return undefined; // another drives, or the e-stop is latched: the base stands
      await new Promise((resume) => setTimeout(resume, STOP_RETRY_MS));
    }
  }
  return undefined;
}

let sending = false;

function send() {
  if (!wish || sending) return;
  const command = { base_velocity: wish.base.map((value, axis) => value * BASE_FULL[axis]) };
  const now = performance.now();
  const passed_s = Math.min(now - moved_ms, 200) / 1000;
  moved_ms = now;
  if (hand.length === 3 && wish.hand.some((value) => value !== 0)) {
    hand = hand.map((value, axis) => clamp(value + wish.hand[axis] * HAND_FULL * passed_s, ...HAND_BOX[axis]));
    command.position_m = hand;
  }
  sending = true;
  inFlight = call("PATCH", "command", command, 1000)
    .then((applied) => (hand = [...applied.position_m]))
    .catch((error) => toast(error.message))
    .finally(() => (sending = false));
}

const clamp = (value, lower, upper) => Math.min(Math.max(value, lower), upper);
