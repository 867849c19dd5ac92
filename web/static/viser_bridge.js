// Runs inside Viser's page, before Viser itself.
(() => {
  // Shortcuts belong to the page around the scene. Capturing keeps Viser from also moving the camera with E.
  window.addEventListener(
    "keydown",
    (event) => {
      if (event.forcelensRelayed || window.parent === window || !window.parent.forcelensTakeKey?.(event)) return;
      event.preventDefault();
      event.stopImmediatePropagation();
    },
    { capture: true },
  );

  // Below this width Viser shows its panels as a sheet. Docked ones would leave a small window no scene.
  const matchMedia = window.matchMedia.bind(window);
  window.matchMedia = (query) => matchMedia(query.replace("36em", "56em"));

  // Viser reconnects only while its document has the focus, which mostly lies with the page around it.
  document.hasFocus = () => true;

  // A checkbox or button that was clicked must not keep the Space bar for itself.
  window.addEventListener("click", (event) => {
    const active = document.activeElement;
    if (event.detail > 0 && active?.matches("button, input[type=checkbox]")) active.blur();
  });

  // Viser's bottom sheet has no hook of its own; its handle's height tells it apart. Marked, viser.css makes it a drawer.
  const mark = () => {
    const sheet = document.querySelector('[style*="min-height: 3.5em"][style*="position: fixed"]');
    if (sheet) sheet.dataset.forcelens = "sheet";
  };

  // Viser's notice of slow rendering stays for ever and covers the scene of exactly those who see it.
  const dismiss = () => {
    const notice = [...document.querySelectorAll(".mantine-Notification-root")].find(
      (box) => !box.dataset.forcelens && box.textContent.includes("Software WebGL"),
    );
    if (!notice) return;
    notice.dataset.forcelens = "seen";
    setTimeout(() => notice.querySelector("button")?.click(), 6000);
  };
  new MutationObserver(() => {
    mark();
    dismiss();
  }).observe(document.documentElement, { childList: true, subtree: true });
})();
