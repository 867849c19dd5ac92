"""What does not fit into a snapshot is refused with the limit where a session meets it, instead of being cut."""

from collections.abc import Mapping
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest

import control.pipeline
from control.estimation.registry import EstimatorsConfig, make_estimators
from control.pipeline import PipelineConfig
from control.timing import Job, TimetableError, slots
from control.whole_body.model_based import ModelBasedController
from sim import scenes
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import MAX_ESTIMATORS, MAX_OBJECTS, NAME_BYTES, SNAPSHOT
from sim.runtime.snapshot_limits import SnapshotLimitError, check_name

LONGEST = "n" * NAME_BYTES
TOO_LONG = LONGEST + "n"
LIGHT = SimulationConfig(
    pipeline=PipelineConfig("model_based", "adaptive", policies=None, estimators=EstimatorsConfig(weights=None))
)


def register_estimators(monkeypatch: pytest.MonkeyPatch, *names: str) -> None:
    """Besides the model-based three."""

    def make(model, config):
        estimators = make_estimators(model, config)
        return estimators | dict.fromkeys(names, estimators["gmo_pi"])

    monkeypatch.setattr(control.pipeline, "make_estimators", make)


def register_scene(monkeypatch: pytest.MonkeyPatch, name: str, balls: int) -> None:
    def add_objects(spec: mujoco.MjSpec, values: Mapping[str, float]) -> tuple[str, ...]:
        for index in range(balls):
            body = spec.worldbody.add_body(name=f"ball_{index}", pos=[3.0 + index, 0.0, 0.1])
            body.add_freejoint()
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.1, 0.0, 0.0])
        return tuple(f"ball_{index}" for index in range(balls))

    made = SimpleNamespace(DESCRIPTION="balls", PARAMETERS=(), PADDED=(), readings=tuple, add_objects=add_objects)
    monkeypatch.setitem(scenes._SCENES, name, made)


def test_the_longest_name_survives_a_record_and_a_longer_one_is_refused() -> None:
    check_name("scene", LONGEST)
    record = np.zeros(1, SNAPSHOT)[0]
    record["scene"] = LONGEST
    assert record["scene"].decode() == LONGEST
    for name in (TOO_LONG, "", "Klötze"):
        with pytest.raises(SnapshotLimitError, match=r"scene .* a snapshot holds 1 to 16"):
            check_name("scene", name)


def test_as_many_estimators_as_have_slots_are_all_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    most = len(slots(Job.SHOWN_ESTIMATE)) + 1
    assert most <= MAX_ESTIMATORS
    register_estimators(monkeypatch, LONGEST, *(f"estimator_{index}" for index in range(most - 4)))
    assert len(Simulation(LIGHT).pipeline.estimator_names) == most


def test_one_more_estimator_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    most = len(slots(Job.SHOWN_ESTIMATE)) + 1
    register_estimators(monkeypatch, *(f"estimator_{index}" for index in range(most - 2)))
    with pytest.raises(TimetableError, match=rf"slots for {most} estimators, not for gmo_pi, .*leave some out"):
        Simulation(LIGHT)


def test_an_estimator_with_too_long_a_name_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    register_estimators(monkeypatch, TOO_LONG)
    with pytest.raises(SnapshotLimitError, match=f"estimator '{TOO_LONG}' has 17 bytes"):
        Simulation(LIGHT)


def test_a_controller_with_too_long_a_name_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    session = Simulation(LIGHT)
    session.pipeline.add_controller(TOO_LONG, ModelBasedController(session.pipeline.model))
    with pytest.raises(SnapshotLimitError, match=f"controller '{TOO_LONG}' has 17 bytes"):
        session.select_controller(TOO_LONG)
    assert session.pipeline.controller_name == "model_based"
    monkeypatch.setattr(control.pipeline, "make_policies", lambda _, model: {TOO_LONG: ModelBasedController(model)})
    with pytest.raises(SnapshotLimitError, match=f"controller '{TOO_LONG}' has 17 bytes"):
        Simulation(LIGHT)


def test_a_scene_that_does_not_fit_is_refused_and_nothing_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    register_scene(monkeypatch, TOO_LONG, 1)
    register_scene(monkeypatch, "crowd", MAX_OBJECTS + 1)
    register_scene(monkeypatch, "few", MAX_OBJECTS)
    session = Simulation(LIGHT)
    with pytest.raises(SnapshotLimitError, match=f"scene '{TOO_LONG}' has 17 bytes"):
        session.set_scene(TOO_LONG)
    with pytest.raises(SnapshotLimitError, match=r"9 movable bodies in scene 'crowd', ball_0.*holds 8 \(MAX_OBJECTS"):
        session.set_scene("crowd")
    assert session.backend.scene == "free"
    session.set_scene("few")
    assert session.backend.scene == "few"
