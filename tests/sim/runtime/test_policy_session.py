"""A learned policy in a running session: it takes over without a jolt, and the snapshot shows what it observes and does."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from control.baselines.baseline_controller import BaselineController
from control.baselines.baseline_weights import load_baseline
from control.command.limits import DEFAULT_COMMAND
from control.joints import JOINT_COUNT, LEG_SLICE
from control.pipeline import PipelineConfig
from control.policy.observation import EXTENDED_FORM, RESIDUAL_FORM, Observation
from control.policy.policy_weights import PolicyManifest, interface, save_policy
from sim.runtime.simulation import Simulation, SimulationConfig
from sim.runtime.snapshot import SNAPSHOT, Mode
from tests.control.baselines.test_baselines import write_baseline

COMMAND = replace(
    DEFAULT_COMMAND,
    mask=np.array([0.0, 0.0, 1.0]),
    force_n=np.array([0.0, 0.0, 5.0]),
    base_velocity=np.array([0.3, 0.0, 0.2]),
)
OBSERVATION = Observation(EXTENDED_FORM)
JOLT_NM = 1.2
"""Torque step of one tick. Without a blend the slew limit lets a leg take 4 N m at once."""


def write_policy(directory: Path, weight: np.ndarray, bias: np.ndarray, form: str = EXTENDED_FORM) -> None:
    """A policy of one linear layer."""
    layers = (OBSERVATION.size, JOINT_COUNT)
    manifest = PolicyManifest("policy", form, interface(form), layers, meets_score=True)
    save_policy(directory, manifest, {"weight_0": weight, "bias_0": bias})


def repeat(directory: Path) -> None:
    """A policy that repeats the previous action: it holds what the controller before it did."""
    weight = np.zeros((JOINT_COUNT, OBSERVATION.size))
    weight[:, OBSERVATION.groups["previous_action"]] = np.eye(JOINT_COUNT)
    write_policy(directory, weight, np.zeros(JOINT_COUNT))


def jump(directory: Path) -> None:
    """A policy whose first action is far from what the controller before it did."""
    write_policy(directory, np.zeros((JOINT_COUNT, OBSERVATION.size)), np.linspace(-1.5, 1.5, JOINT_COUNT))


def correct(directory: Path) -> None:
    """A policy that shifts what the model-based controller does by a constant."""
    write_policy(directory, np.zeros((JOINT_COUNT, OBSERVATION.size)), np.linspace(-0.2, 0.2, JOINT_COUNT), RESIDUAL_FORM)


def moving(policies: Path) -> Simulation:
    pipeline = PipelineConfig(controller="model_based", policies=policies)
    session = Simulation(SimulationConfig(seed=3, pipeline=pipeline))
    torques(session, 500)
    return session


def torques(session: Simulation, ticks: int) -> np.ndarray:
    """The part (ticks, 22) of the joint torques, N m, that the command and not the motion decides."""
    commands = [session.tick(COMMAND).joint_command for _ in range(ticks)]
    return np.array([each.stiffness * each.position + each.damping * each.velocity + each.torque for each in commands])


@pytest.mark.parametrize(
    ("write", "names"),
    [(repeat, ("policy", "model_based")), (correct, ("policy", "model_based", "policy")), (jump, ("policy",))],
)
def test_swapping_controllers_in_motion_is_no_jolt(
    tmp_path: Path, write: Callable[[Path], None], names: tuple[str, ...]
) -> None:
    write(tmp_path)
    session = moving(tmp_path)
    told = [torques(session, 1)]
    for name in names:
        session.select_controller(name)
        # The blend; what a policy that cannot drive does afterwards is its own.
        told.append(torques(session, round(session.pipeline.config.safety.handover_s * 500)))
        assert session.mode is Mode.RUNNING
    steps = np.abs(np.diff(np.concatenate(told), axis=0))[:, LEG_SLICE]
    assert steps.max() < JOLT_NM


def test_the_snapshot_shows_what_the_selected_policy_observes_and_does(tmp_path: Path) -> None:
    repeat(tmp_path)
    session = moving(tmp_path)
    snapshot = np.zeros(1, SNAPSHOT)[0]
    session.fill(snapshot)
    assert snapshot["policy_form"] == b""
    session.select_controller("policy")
    torques(session, 20)
    session.fill(snapshot)
    assert snapshot["policy_form"] == EXTENDED_FORM.encode()
    shown = {name: snapshot["policy_observation"][where] for name, where in OBSERVATION.groups.items()}
    np.testing.assert_array_equal(shown["mask"], COMMAND.mask)
    assert np.linalg.norm(shown["gravity"]) == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(snapshot["policy_action"], shown["previous_action"], atol=1e-5)
    session.select_controller("model_based")
    torques(session, 10)
    session.fill(snapshot)
    assert snapshot["policy_form"] == b""


def test_the_snapshot_shows_the_force_that_the_selected_controller_estimates_itself(tmp_path: Path) -> None:
    repeat(tmp_path)
    session, snapshot = moving(tmp_path), np.zeros(1, SNAPSHOT)[0]
    write_baseline(tmp_path, "portela")
    baseline = BaselineController(*load_baseline("portela", tmp_path))
    session.pipeline.add_controller("portela", baseline)
    session.select_controller("portela")
    torques(session, 10)
    session.fill(snapshot)
    assert baseline.force_estimated_n.any()
    np.testing.assert_array_equal(snapshot["force_of_controller_n"], baseline.force_estimated_n)
    session.select_controller("model_based")
    torques(session, 10)
    session.fill(snapshot)
    assert np.isnan(snapshot["force_of_controller_n"]).all()
