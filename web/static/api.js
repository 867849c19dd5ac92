/** Calls of the REST API, and the newest state from its stream. */

const ROOT = new URL("api/v1/", document.baseURI);

/** The API refused, with `status`, or could not be reached; `message` is fit for the operator. */
export class ApiError extends Error {
  constructor(message, status) {
    super(message);
    this.status = status;
  }
}

/** Call `method path` with a JSON body; returns the answer's JSON. Throws ApiError, with `timeoutMs` also when none comes whole. */
export async function call(method, path, body, timeoutMs) {
  let response, text;
  try {
    response = await fetch(new URL(path, ROOT), {
      method,
      headers: body === undefined ? {} : { "Content-Type": "application/json" },
      body: body === undefined ? undefined : JSON.stringify(body),
      signal: timeoutMs === undefined ? undefined : AbortSignal.timeout(timeoutMs),
    });
    text = await response.text();
  } catch {
    throw new ApiError("The server does not answer. Is it still running?");
  }
  const answer = parsed(text);
  if (!response.ok)
    throw new ApiError(reason(answer) ?? `${method} ${path} failed with status ${response.status}.`, response.status);
  if (response.status === 204) return null;
  if (answer === undefined) throw new ApiError(`${method} ${path} was answered by something else than the console: a proxy?`);
  return answer;
}

/** The JSON in `text`, undefined where it is something else. */
function parsed(text) {
  try {
    return JSON.parse(text);
  } catch {
    return undefined;
  }
}

function reason(answer) {
  const detail = answer?.detail ?? answer?.error ?? answer?.message;
  if (Array.isArray(detail)) return detail.map((item) => item.msg ?? String(item)).join("; ");
  return typeof detail === "object" ? detail?.message : detail;
}

const STALE_MS = 3000;
const SECOND_LOOK_MS = 1000;
const RETRY_MS = 700;

/**
 * Follow the state stream and reconnect for ever.
 * @param {(state: object) => void} onState newest snapshot
 * @param {(link: "live" | "connecting" | "lost") => void} onLink
 */
export function followState(rateHz, onState, onLink) {
  let watchdog = 0;

  function connect() {
    const url = new URL(`stream?rate_hz=${rateHz}`, ROOT);
    url.protocol = url.protocol.replace("http", "ws");
    const socket = new WebSocket(url);
    // A page that was busy drawing finds the timer and its messages due at once: look again before giving up.
    const suspect = () => (watchdog = setTimeout(() => socket.close(), SECOND_LOOK_MS));
    socket.onmessage = (event) => {
      clearTimeout(watchdog);
      watchdog = setTimeout(suspect, STALE_MS);
      onLink("live");
      onState(JSON.parse(event.data));
    };
    socket.onclose = () => {
      clearTimeout(watchdog);
      onLink("lost");
      setTimeout(connect, RETRY_MS);
    };
  }

  onLink("connecting");
  connect();
}
