"""Which parts make up which body, and the committed files that hold them."""

from pathlib import Path

from control.joints import LEGS
from control.paths import ASSETS
from web.robot_visuals import arm, leg
from web.robot_visuals.base import base_parts
from web.robot_visuals.export import to_glb
from web.robot_visuals.part import Part, mirrored
from web.robot_visuals.wheel import wheel_parts

VISUAL_FOLDER = ASSETS / "robot" / "visual"
BODY_NAMES = (
    "base",
    *(f"{name}_{link}" for name in LEGS for link in ("hip", "thigh", "calf", "wheel")),
    "arm_base",
    *(f"arm_link{index}" for index in range(1, 7)),
    "end_effector",
)
"""Bodies of assets/robot/robot.xml that have a visual."""


class MissingVisualError(FileNotFoundError):
    """A visual file is not where the package expects it."""

    def __init__(self, path: Path) -> None:
        super().__init__(f"robot visual {path} is missing; write all of them with: python -m web.robot_visuals")
        self.path = path


def build_parts() -> dict[str, list[Part]]:
    """Parts of every body, in the body's own frame (m)."""
    bodies = {"base": base_parts()}
    left = {"hip": leg.hip_parts(), "thigh": leg.thigh_parts(), "calf": leg.calf_parts(), "wheel": wheel_parts()}
    right = {link: mirrored(parts, "y") for link, parts in left.items()}
    for name in LEGS:
        bodies |= {f"{name}_{link}": parts for link, parts in (left if name.endswith("L") else right).items()}
    bodies["arm_base"] = arm.arm_base_parts()
    links = (
        arm.arm_link1_parts,
        arm.arm_link2_parts,
        arm.arm_link3_parts,
        arm.arm_link4_parts,
        arm.arm_link5_parts,
        arm.arm_link6_parts,
    )
    bodies |= {f"arm_link{index}": parts() for index, parts in enumerate(links, start=1)}
    bodies["end_effector"] = arm.end_effector_parts()
    return bodies


def build() -> dict[str, bytes]:
    """GLB of every body by name; the same bytes on every call."""
    return {name: to_glb(parts) for name, parts in build_parts().items()}


def load(folder: Path = VISUAL_FOLDER) -> dict[str, bytes]:
    """Read the committed GLB of every body.

    Raises:
        MissingVisualError: a file is missing; the message names it and the command that writes it.
    """
    visuals = {}
    for name in BODY_NAMES:
        path = folder / f"{name}.glb"
        try:
            visuals[name] = path.read_bytes()
        except FileNotFoundError as error:
            raise MissingVisualError(path) from error
    return visuals
