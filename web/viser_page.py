"""Viser's own page with the few lines that make it part of the console.

The bytes come from the installed package, whose version must match its server's, and get a style and a script:
keyboard shortcuts reach the page around it wherever the focus is, and on a phone the panel is a drawer that shrinks the
scene instead of covering it. `data-testid` and the drawer's markup are Viser 1.1.1's; the pinned version keeps them valid.
"""

from functools import cache
from pathlib import Path

import viser

STATIC = Path(__file__).parent / "static"
CLIENT = Path(str(viser.__file__)).parent / "client" / "build" / "index.html"


@cache
def viser_page() -> bytes:
    """The page to serve at `/viser/`.

    Raises:
        RuntimeError: the installed Viser has no built client, or one of an unknown form.
    """
    if not CLIENT.is_file():
        raise RuntimeError(f"{CLIENT} is missing; reinstall viser from its wheel")
    page = CLIENT.read_text(encoding="utf-8")
    if "<head>" not in page:
        raise RuntimeError(f"{CLIENT} has no <head>; install the viser version of pyproject.toml")
    style = (STATIC / "viser.css").read_text(encoding="utf-8")
    script = (STATIC / "viser_bridge.js").read_text(encoding="utf-8")
    # First in <head>: the script must register its listeners before Viser's own.
    injected = f"<head><style>{style}</style><script>{script}</script>"
    return page.replace("<head>", injected, 1).encode()
