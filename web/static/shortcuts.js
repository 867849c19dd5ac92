/** Keyboard shortcuts of the page and, through viser_bridge.js, of the scene inside it. */

const dialog = document.getElementById("shortcuts");
const actions = new Map();

/** "E" and "e" are one key; punctuation and named keys stand for themselves. */
const normal = (key) => (key.length === 1 ? key.toUpperCase() : key);

/**
 * Bind keys to an action and list them in the help.
 * @param {{keys: string[], label: string, words: string, act?: () => void}[]} table without `act`, for the help only
 */
export function bindShortcuts(table) {
  const list = document.getElementById("shortcut-list");
  for (const { keys, label, words, act } of table) {
    const term = document.createElement("dt");
    label.split(" ").forEach((name, index) => {
      if (index) term.append(" ");
      const key = document.createElement("kbd");
      key.textContent = name;
      term.append(key);
    });
    const description = document.createElement("dd");
    description.textContent = words;
    list.append(term, description);
    if (act) keys.forEach((key) => actions.set(key, act));
  }
}

/** Act on a key; true when it was one of ours. */
export function press(key) {
  const act = actions.get(normal(key));
  act?.();
  return act !== undefined;
}

/** Show or hide the help. */
export function toggleHelp() {
  if (dialog.open) dialog.close();
  // Not modal: nothing may keep the e-stop from being pressed.
  else dialog.show();
}

const typing = (target) => target.matches?.("input, textarea, select, [contenteditable]");

window.addEventListener("keydown", (event) => {
  if (event.repeat || event.ctrlKey || event.metaKey || event.altKey) return;
  if (event.key !== "Escape" && typing(event.target)) return;
  // A button that was reached with Tab is pressed with Space, as everywhere.
  if (event.key === " " && event.target.matches?.("button:focus-visible")) return;
  if (press(event.key)) event.preventDefault();
});

// A button that was clicked must not keep the Space bar for itself.
window.addEventListener("click", (event) => {
  if (event.detail > 0) event.target.closest?.("button")?.blur();
});

window.addEventListener("message", (event) => {
  if (event.origin === location.origin && event.data?.type === "forcelens-key") press(event.data.key);
});
