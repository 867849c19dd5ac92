"""Floor only: driving, reaching, dragging by hand."""

import mujoco

DESCRIPTION = "Flat floor, nothing else"


def add_objects(spec: mujoco.MjSpec) -> tuple[str, ...]:
    """Nothing to add to `spec`; no body moves."""
    return ()
