/** Keyboard shortcuts of the page and, through viser_bridge.js, of the scene inside it. */

const dialog = document.getElementById("shortcuts");
const shortcuts = [];

/** Place on a US keyboard of a key that has none of its own: of a screen keyboard, or on the number pad. */
function placeOfKey(key) {
  if (/^[a-z]$/i.test(key)) return `Key${key.toUpperCase()}`;
  if (/^[0-9]$/.test(key)) return `Digit${key}`;
  return { " ": "Space", ".": "Period", "?": "Shift+Slash" }[key] ?? key;
}

/** Where a key lies, as on a US keyboard, whatever is printed on it: KeyboardEvent.code, with Shift where it is held. */
function placesOf({ code, key, shiftKey }) {
  const place = code && code !== "Unidentified" && !code.startsWith("Numpad") ? code : placeOfKey(key);
  return shiftKey ? [place, `Shift+${place}`] : [place];
}

/**
 * Bind keys to an action and list them in the help; where two claim a key, the first has it.
 * @param {{places: string[], prints?: string, label: string, words: string, act: () => void}[]} table with `prints`, also the
 *   key that types this, wherever it lies
 */
export function bindShortcuts(table) {
  const list = document.getElementById("shortcut-list");
  for (const { label, words } of table) {
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
  }
  shortcuts.push(...table);
}

/** Show or hide the help. */
export function toggleHelp() {
  if (dialog.open) dialog.close();
  // Not modal: nothing may keep the e-stop from being pressed.
  else dialog.show();
}

const typing = (target) => target.matches?.("input:not([type=checkbox]), textarea, select, [contenteditable]");

/** Act on a pressed key, of the page or of the scene; true when it is taken, and nobody else shall see it. */
function take(event) {
  if (event.repeat) return false;
  const places = placesOf(event);
  const typed = event.key?.toUpperCase() ?? "";
  const found = shortcuts.find((each) => each.places.some((place) => places.includes(place)) || each.prints === typed);
  if (!found) return false;
  // Escape stops whatever is held, typed or open besides; what it closes, it still closes.
  const always = places.includes("Escape");
  if (!always) {
    if (event.ctrlKey || event.metaKey || event.altKey || event.isComposing || typing(event.target)) return false;
    // What was reached with Tab is pressed with Space, as everywhere.
    if (places.includes("Space") && event.target.matches?.(":focus-visible:not(body, canvas)")) return false;
  }
  found.act();
  return !always;
}

window.addEventListener("keydown", (event) => {
  if (take(event)) event.preventDefault();
});

/** For viser_bridge.js. */
window.forcelensTakeKey = take;

// A button that was clicked must not keep the Space bar for itself.
window.addEventListener("click", (event) => {
  if (event.detail > 0) event.target.closest?.("button")?.blur();
});
