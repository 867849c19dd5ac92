/** The e-stop: one press stops, the backend's report latches the button, and clearing takes two deliberate presses. */

import { call } from "./api.js";
import { hideBanner, showBanner } from "./banners.js";
import { reporting, toast } from "./toast.js";

const button = document.getElementById("estop");
const RETRY_MS = 250;
const ATTEMPTS = 8;
const ANSWER_WITHIN_MS = 1500;

/** Stop, and keep trying for a while: a lost request must not be the end of it. */
export async function stop() {
  button.dataset.pending = "true";
  for (let attempt = 1; ; attempt += 1) {
    try {
      await call("POST", "estop", undefined, ANSWER_WITHIN_MS);
      break;
    } catch (error) {
      if (attempt === ATTEMPTS) {
        toast(`E-STOP NOT CONFIRMED: ${error.message} Use the robot's own stop.`);
        break;
      }
      await new Promise((resume) => setTimeout(resume, RETRY_MS));
    }
  }
  delete button.dataset.pending;
}

/** Show whether the backend reports a latched e-stop; `message` says what that means, `confirm` what clearing it does. */
export function showEstop(latched, message, confirm) {
  if (button.dataset.latched === String(latched)) return;
  button.dataset.latched = String(latched);
  button.textContent = latched ? "STOPPED" : "E-STOP";
  if (!latched) return hideBanner("estop");
  showBanner("estop", "stop", message, {
    label: "Clear e-stop",
    confirm,
    act: () => reporting(() => call("POST", "estop/clear")),
  });
}

button.addEventListener("click", stop);
