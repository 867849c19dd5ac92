/** Two sticks on a touch screen: the left one drives the base, the right one moves the hand; letting go stops. */

import { pilot } from "./pilot.js";

const LABELS = { base: "Base: ahead, turn", hand: "Hand: up, sideways" };

const deflections = { base: null, hand: null };

/** Right and up, each -1 to 1, of a finger on a stick. */
function deflection(stick, event) {
  const box = stick.getBoundingClientRect();
  const radius = box.width / 2;
  const x = (event.clientX - box.left) / radius - 1;
  const y = 1 - (event.clientY - box.top) / radius;
  const length = Math.max(Math.hypot(x, y), 1);
  return [x / length, y / length];
}

function tell() {
  const { base, hand } = deflections;
  if (!base && !hand) return pilot(null);
  const [turn, ahead] = base ?? [0, 0];
  const [right, up] = hand ?? [0, 0];
  return pilot({ base: [ahead, 0, 0 - turn], hand: [0, 0 - right, up] });
}

function makeStick(name) {
  const stick = document.createElement("div");
  const knob = document.createElement("div");
  stick.className = `stick stick-${name}`;
  stick.dataset.testid = `stick-${name}`;
  stick.setAttribute("aria-label", LABELS[name]);
  stick.append(knob);

  function show(at) {
    deflections[name] = at;
    knob.style.translate = at ? `${at[0] * 60}% ${-at[1] * 60}%` : "";
    tell();
  }
  stick.addEventListener("pointerdown", (event) => {
    stick.setPointerCapture(event.pointerId);
    event.preventDefault();
    show(deflection(stick, event));
  });
  stick.addEventListener("pointermove", (event) => {
    if (deflections[name] && stick.hasPointerCapture(event.pointerId)) show(deflection(stick, event));
  });
  for (const ended of ["pointerup", "pointercancel", "lostpointercapture"])
    stick.addEventListener(ended, () => deflections[name] && show(null));
  document.addEventListener("visibilitychange", () => document.hidden && deflections[name] && show(null));
  return stick;
}

const stage = document.querySelector(".stage");
const toggle = document.createElement("button");
toggle.type = "button";
toggle.className = "sticks-toggle round";
toggle.dataset.testid = "sticks";
toggle.textContent = "✥";
toggle.setAttribute("aria-label", "Sticks that drive base and hand");
toggle.setAttribute("aria-pressed", "false");
toggle.onclick = () => toggle.setAttribute("aria-pressed", String(stage.classList.toggle("with-sticks")));
stage.append(toggle, makeStick("base"), makeStick("hand"));
