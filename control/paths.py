"""Paths of the installed project: the only place that knows how deep a file lies."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
"""Folder of the packages: the checkout, or site-packages."""

ASSETS = ROOT / "assets"
ROBOT_MJCF = ASSETS / "robot" / "robot.xml"
WEIGHTS_DIRECTORY = ASSETS / "weights"
