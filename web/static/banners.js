/** Lines below the status bar that say what is wrong and offer the cure. */

const container = document.getElementById("banners");
const shown = new Map();

/**
 * Show a banner, or change the one of the same name.
 * @param {string} name
 * @param {"stop" | "warn"} kind
 * @param {string} text
 * @param {{label: string, confirm?: string, act: () => Promise<void> | void}} [action] with `confirm`, a second press acts
 */
export function showBanner(name, kind, text, action) {
  let banner = shown.get(name);
  if (!banner) {
    banner = document.createElement("div");
    banner.dataset.testid = `banner-${name}`;
    banner.append(document.createElement("p"));
    if (action) banner.append(actionButton(name, action));
    container.append(banner);
    shown.set(name, banner);
  }
  banner.dataset.kind = kind;
  const paragraph = banner.querySelector("p");
  if (paragraph.textContent !== text) paragraph.textContent = text;
}

/** Take a banner away. */
export function hideBanner(name) {
  shown.get(name)?.remove();
  shown.delete(name);
}

const CONFIRM_MS = 5000;

function actionButton(name, { label, confirm, act }) {
  const button = document.createElement("button");
  button.type = "button";
  button.dataset.testid = `${name}-action`;
  button.textContent = label;
  let disarm = 0;
  button.onclick = async () => {
    if (confirm && button.dataset.armed !== "true") {
      button.dataset.armed = "true";
      button.textContent = confirm;
      disarm = setTimeout(reset, CONFIRM_MS);
      return;
    }
    reset();
    button.disabled = true;
    try {
      await act();
    } finally {
      button.disabled = false;
    }
  };
  function reset() {
    clearTimeout(disarm);
    delete button.dataset.armed;
    button.textContent = label;
  }
  return button;
}
