"""What fits into a snapshot, checked when a session meets what is registered: a longer name would be cut without a word."""

from control.pipeline import Pipeline
from control.policy.policy_controller import PolicyController
from sim.runtime.snapshot import MAX_OBJECTS, MAX_OBSERVATION, MAX_PARAMETERS, MAX_READINGS, NAME_BYTES
from sim.scenes import SceneModel


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


def check_scene(scene: SceneModel) -> None:
    """
    Raises:
        SnapshotLimitError: a name in a scene is too long, or too many of its bodies move, or of its readings or parameters.
    """
    name, movable_bodies = scene.name, scene.movable_bodies
    check_name("scene", name)
    readings = [reading.name for reading in scene.readings]
    kinds = (("reading", readings, MAX_READINGS), ("parameter", list(scene.values), MAX_PARAMETERS))
    for kind, names, most in kinds:
        for item in names:
            check_name(kind, item)
        if len(names) > most:
            raise SnapshotLimitError(f"scene {name!r} has {len(names)} {kind}s", str(most), f"MAX_{kind.upper()}S")
    if len(movable_bodies) > MAX_OBJECTS:
        what = f"there are {len(movable_bodies)} movable bodies in scene {name!r}, {', '.join(movable_bodies)}"
        raise SnapshotLimitError(what, str(MAX_OBJECTS), "MAX_OBJECTS")
