"""What fits into a snapshot, checked when a session meets what is registered: a longer name would be cut without a word."""

from collections.abc import Sequence

from control.pipeline import Pipeline
from control.policy.policy_controller import PolicyController
from sim.runtime.snapshot import MAX_OBJECTS, MAX_OBSERVATION, NAME_BYTES


class SnapshotLimitError(ValueError):
    """Something is registered that a SNAPSHOT record cannot hold; the message names it, the limit and where that stands."""

    def __init__(self, what: str, limit: str, constant: str) -> None:
        super().__init__(f"{what}; a snapshot holds {limit} ({constant} in sim/runtime/snapshot.py)")


def check_name(kind: str, name: str) -> None:
    """
    Raises:
        SnapshotLimitError: the name of a `kind` of thing is empty, not ASCII or longer than NAME_BYTES.
    """
    if not (name.isascii() and 1 <= len(name) <= NAME_BYTES):
        raise SnapshotLimitError(f"{kind} {name!r} has {len(name.encode())} bytes", f"1 to {NAME_BYTES} of ASCII", "NAME_BYTES")


def check_pipeline(pipeline: Pipeline) -> None:
    """
    Raises:
        SnapshotLimitError: a name or an observation is too long. (The number of estimators is limited by control.timing.)
    """
    for name in pipeline.estimator_names:
        check_name("estimator", name)
    for name, controller in pipeline.controllers.items():
        check_name("controller", name)
        if isinstance(controller, PolicyController):
            check_name(f"observation form of policy {name!r}:", controller.manifest.form)
            size = len(controller.observation)
            if size > MAX_OBSERVATION:
                raise SnapshotLimitError(f"policy {name!r} observes {size} values", str(MAX_OBSERVATION), "MAX_OBSERVATION")


def check_scene(name: str, movable_bodies: Sequence[str]) -> None:
    """
    Raises:
        SnapshotLimitError: a scene's name is too long, or more than MAX_OBJECTS of its bodies move.
    """
    check_name("scene", name)
    if len(movable_bodies) > MAX_OBJECTS:
        what = f"there are {len(movable_bodies)} movable bodies in scene {name!r}, {', '.join(movable_bodies)}"
        raise SnapshotLimitError(what, str(MAX_OBJECTS), "MAX_OBJECTS")
