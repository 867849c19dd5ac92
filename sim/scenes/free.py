"""Floor only: driving, reaching, dragging by hand."""

from collections.abc import Mapping

import mujoco

from sim.scenes.scene import Parameter, Reading

DESCRIPTION = "Flat floor, nothing else"
PARAMETERS: tuple[Parameter, ...] = ()
PADDED: tuple[str, ...] = ()


def readings() -> tuple[Reading, ...]:
    """None."""
    return ()


def add_objects(spec: mujoco.MjSpec, values: Mapping[str, float]) -> tuple[str, ...]:
    """Nothing to add to `spec`; no body moves."""
    return ()
