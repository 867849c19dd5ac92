/** What ties the page to the console: the stream of its state, and its word that this page may stop the robot. */

import { call, followState } from "./api.js";

const CHECK_PERIOD_MS = 1000;
const CHECK_TIMEOUT_MS = 3000;
const REFUSALS = [401, 403];
const NO_SOCKET = "The server answers, but not with the robot's state: a proxy must let WebSockets through. Trying again.";

/**
 * Follow the state for ever. The link is live while the stream flows and the page's e-stop would be heard: a cookie can be
 * lost while a stream flows on.
 * @param {number} rateHz
 * @param {(state: object) => void} onState newest snapshot
 * @param {(link: "live" | "connecting" | "lost" | "refused", reason?: string) => void} onLink with the reason, if known
 */
export function watchLink(rateHz, onState, onLink) {
  let stream = "connecting";
  let permission = "connecting";
  let reason = "";
  let timer = 0;

  function tell() {
    if (permission === "refused") onLink("refused", reason);
    else if (stream === "live") onLink(permission);
    else onLink(stream, permission === "live" ? NO_SOCKET : undefined);
  }

  async function check() {
    clearTimeout(timer);
    try {
      await call("POST", "estop/check", undefined, CHECK_TIMEOUT_MS);
      permission = "live";
    } catch (error) {
      permission = REFUSALS.includes(error.status) ? "refused" : "lost";
      reason = error.message;
    }
    tell();
    clearTimeout(timer);
    timer = setTimeout(check, CHECK_PERIOD_MS);
  }

  check();
  followState(rateHz, onState, (now) => {
    const changed = now !== stream;
    stream = now;
    tell();
    if (changed) check();
  });
}
