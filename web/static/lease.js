/** Who drives: shown in the bar, with one button that takes the lease, gives it back, or takes over from another. */

import { call } from "./api.js";
import { reporting, toast } from "./toast.js";

const PERIOD_MS = 1000;
const TIMEOUT_MS = 3000;
const NAME_KEY = "forcelens-operator";
const WORDS = { free: "anyone", ours: "you" };
const LABELS = { free: "Drive", ours: "Release", theirs: "Take over" };
const TITLES = {
  free: "Take the lease: you command, and all others watch.",
  ours: "Give the lease back. The base stops.",
  theirs: "Command instead of who drives now. The base stops.",
};

const driver = fact("Driver", "driver");
const button = document.createElement("button");
button.type = "button";
button.id = button.dataset.testid = "drive";
document.getElementById("help").before(button);

let lease = { operator: null, yours: false };
let asked = -Infinity;
let calls = Promise.resolve();

/** One after the other: a renewal that overtakes a release would take the lease again. */
function inOrder(job) {
  const done = calls.then(job);
  calls = done.catch(() => {});
  return done;
}

let ownName = stored() ?? `Operator ${100 + Math.floor(900 * Math.random())}`;

/** The name that was chosen in this browser; null for none, or where the browser keeps nothing. */
function stored() {
  try {
    return localStorage.getItem(NAME_KEY);
  } catch {
    return null;
  }
}

function rename(name) {
  ownName = name;
  try {
    localStorage.setItem(NAME_KEY, name);
  } catch {
    // It holds until the page is closed.
  }
}

const state = () => (lease.operator === null ? "free" : lease.yours ? "ours" : "theirs");

function show() {
  const now = state();
  const text = WORDS[now] ?? lease.operator;
  if (driver.textContent !== text) driver.textContent = text;
  driver.dataset.level = now === "theirs" ? "warn" : "";
  if (button.dataset.lease !== now) {
    button.dataset.lease = now;
    button.textContent = LABELS[now];
    button.title = TITLES[now];
    button.setAttribute("aria-pressed", String(now === "ours"));
  }
}

/** Ask who drives, and while that is this page, renew the lease. */
async function refresh() {
  if (lease.yours) await call("POST", "lease", { operator: ownName }, TIMEOUT_MS).catch(() => {});
  const before = lease;
  lease = await call("GET", "lease", undefined, TIMEOUT_MS);
  if (before.yours && !lease.yours) toast(lease.operator ? `${lease.operator} has taken over. The base has stopped.` : "You no longer drive alone.");
  show();
}

async function press() {
  if (state() === "ours") {
    await call("DELETE", "lease", undefined, TIMEOUT_MS);
    lease = { operator: null, yours: false };
  } else {
    await call("POST", "lease", { operator: ownName, take_over: state() === "theirs" }, TIMEOUT_MS);
  }
  await refresh();
}

/** Call with every message of the stream: timers sleep in a page that is not in front, and its operator would lose the lease. */
export function keepLease() {
  if (performance.now() - asked < PERIOD_MS) return;
  asked = Infinity;
  inOrder(refresh)
    .catch(() => {})
    .finally(() => (asked = performance.now()));
}

/** Take the lease if nobody holds it. Throws where another drives. */
export async function claim() {
  if (state() === "theirs") throw new Error(`${lease.operator} drives. Take over first.`);
  await inOrder(() => (state() === "free" ? press() : undefined));
}

function fact(term, id) {
  const entry = document.createElement("div");
  const label = document.createElement("dt");
  const value = document.createElement("dd");
  label.textContent = term;
  value.id = value.dataset.testid = id;
  entry.append(label, value);
  document.querySelector(".facts .link").before(entry);
  return value;
}

function nameField() {
  const label = document.createElement("label");
  const input = document.createElement("input");
  label.className = "operator";
  label.textContent = "Your name, for others who watch: ";
  input.maxLength = 24;
  input.dataset.testid = "operator-name";
  input.value = ownName;
  input.onchange = () => {
    rename(input.value.trim() || ownName);
    input.value = ownName;
  };
  label.append(input);
  document.querySelector("#shortcuts form").before(label);
}

button.onclick = () => reporting(() => inOrder(press));
nameField();
show();
