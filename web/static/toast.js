/** A short message that goes away by itself. */

const box = document.getElementById("toast");
let timer = 0;

/** Show `message` for a few seconds. */
export function toast(message) {
  box.textContent = message;
  box.hidden = false;
  clearTimeout(timer);
  timer = setTimeout(() => (box.hidden = true), 6000);
}

/** Run `action`; show why when the API refuses it. */
export async function reporting(action) {
  try {
    await action();
  } catch (error) {
    toast(error.message);
  }
}
