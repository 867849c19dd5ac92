"""The manuals name what the code has: every signal, links that lead somewhere, commands that exist; the README stays short."""

import importlib.util
import re
from pathlib import Path

import pytest

from control.paths import ROOT
from server.state import SECTIONS
from sim.runtime.snapshot import SNAPSHOT

MANUALS = sorted(ROOT.glob("*.md")) + sorted(
    path for part in ("control", "sim", "web", "server") for path in (ROOT / part).rglob("README.md")
)
README_LINES = 130
INTERNAL = {
    "heading_yaw",
    "held_s",
    "rebases",
    "realtime_scheduling",
    "speed",
    "history_start_s",
    "history_end_s",
    "past",
    "branch",
}
"""Of the snapshot: bookkeeping of the page and the loop, told in the schema of `GET /api/v1/state` where REST has it."""
DRAWN = ("_in_world", "object_", "drag_", "policy_", "drive_", "dry_run")
"""Of the snapshot: what only the scene or a panel draws."""


def text(path: str) -> str:
    return (ROOT / path).read_text(encoding="utf-8")


def test_the_readme_is_for_a_newcomer() -> None:
    assert len(text("README.md").splitlines()) <= README_LINES


@pytest.mark.parametrize("manual", MANUALS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(manual: Path) -> None:
    for target in re.findall(r"\]\(([^)#\s]+)", manual.read_text(encoding="utf-8")):
        if "://" not in target:
            assert (manual.parent / target).exists(), f"{manual}: {target}"


@pytest.mark.parametrize("manual", MANUALS, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_named_modules_exist(manual: Path) -> None:
    for module in re.findall(r"python -m ((?:control|sim|web|server)[\w.]*)", manual.read_text(encoding="utf-8")):
        if not module.endswith("benchmarks"):
            assert module.endswith("NAME") or importlib.util.find_spec(module.rstrip(".")) is not None, f"{manual}: {module}"


def test_every_signal_of_the_snapshot_is_in_the_manual() -> None:
    manual = text("control/README.md")
    names = [name for name in SNAPSHOT.names or () if name not in INTERNAL and not any(part in name for part in DRAWN)]
    assert not [name for name in names if f"`{name}`" not in manual]


def test_every_section_of_the_state_is_in_the_manual() -> None:
    manual = text("control/README.md")
    assert not [name for name in SECTIONS if not re.search(rf"`{name}[`.\[]", manual) and name != "drive"]
