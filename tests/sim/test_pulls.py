"""A firm pull at the hand: the robot yields within a border, and stands."""

from dataclasses import replace

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from control.hand_load.tool import MAX_TOOL_CENTER_M, MAX_TOOL_KG, Tool
from control.paths import WEIGHTS_DIRECTORY
from sim.trials.pull import MODES, Pull, incline, pull
from sim.trials.task_trial import TaskPlan, play
from sim.trials.trial import Trial, controller_setups

POLICY = controller_setups(WEIGHTS_DIRECTORY)["policy"]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "direction"),
    [
        ("guidance", (-1.0, 0.0, 0.0)),
        ("guidance", (0.0, 1.0, 0.0)),
        ("zero_force", (0.0, 1.0, 0.0)),
        ("zero_force", (-1.0, 0.0, 1.0)),
        ("zero_force", (0.0, 0.0, -1.0)),
    ],
)
def test_forty_newtons_fell_no_robot_and_press_no_arm_on_it(mode: str, direction: tuple[float, float, float]) -> None:
    result = pull(Pull(POLICY, mode, 40.0, direction, 0.3, False, seed=611))
    assert not result.fell and not result.self_contact
    assert result.tilt_deg < 15.0
    assert result.excursion_m < 0.55


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mode", "mass_scale", "direction", "seed"),
    [
        ("zero_force", 0.8, (0.0, 1.0, 0.0), 1416),
        ("guidance", 1.0, (-1.0, 1.0, 0.0), 1408),
        ("guidance", 1.2, (0.0, -1.0, 0.0), 1411),
    ],
)
def test_jerks_at_the_rate_of_the_trunk_do_not_rock_it_over(
    mode: str, mass_scale: float, direction: tuple[float, float, float], seed: int
) -> None:
    result = pull(Pull(replace(POLICY, mass_scale=mass_scale), mode, 40.0, direction, 0.05, True, seed))
    assert not result.fell and not result.self_contact
    assert result.tilt_deg < 12.0


@pytest.mark.slow
@pytest.mark.parametrize("direction", [(-1.0, 0.0, 1.0), (-1.0, 0.4, 1.0), (-0.7, 0.0, 1.0)])
def test_a_sudden_pull_back_and_up_lifts_no_wheels_for_good(direction: tuple[float, float, float]) -> None:
    light = replace(controller_setups(WEIGHTS_DIRECTORY)["model_based"], mass_scale=0.8)
    result = pull(Pull(light, "guidance", 40.0, direction, 0.05, False, seed=2403))
    assert not result.fell and not result.self_contact
    assert result.tilt_deg < 12.0


@pytest.mark.slow
def test_a_hand_led_aside_turns_the_robot_with_it() -> None:
    trace = play(TaskPlan("guidance", 878, controller="model_based", options={"lead_s": 22.0}))
    assert len(trace.leads) == 3
    assert all(progress > 0.4 and force < 13.0 for progress, force in trace.leads)


def test_a_floor_rises_under_the_robot_which_stands_on_it_upright() -> None:
    trial = Trial(POLICY, seed=613)
    upright = trial.truth.base_orientation_wxyz
    incline(trial.session.backend.model, np.radians(4.0), np.pi / 2)
    for _ in trial.run(MODES["guidance"], 2.0):
        pass
    truth = trial.truth
    assert not trial.fallen
    assert np.linalg.norm(truth.base_orientation_wxyz - upright) < np.sin(np.radians(2.0))
    left, right = truth.wheel_contact_positions[[0, 2]].mean(0), truth.wheel_contact_positions[[1, 3]].mean(0)
    rise = np.degrees(np.arctan2(left[2] - right[2], np.linalg.norm((left - right)[:2])))
    assert rise == pytest.approx(4.0, abs=0.5), "uphill on its left"


def test_an_untouched_hand_that_is_asked_for_no_force_stays() -> None:
    trial = Trial(POLICY, seed=612)
    start = trial.hand_in_heading
    for _ in trial.run(MODES["zero_force"], 6.0):
        assert np.linalg.norm(trial.hand_in_heading - start) < 0.05


@pytest.mark.slow
@pytest.mark.parametrize(("mask", "seed"), [((0.0, 1.0, 0.0), 1), ((0.0, 1.0, 0.0), 2), ((1.0, 1.0, 1.0), 2)])
def test_a_tool_that_is_told_but_not_there_fells_no_robot(mask: tuple[float, float, float], seed: int) -> None:
    """It is felt as a force that is none and as an inertia that is not there: a loop that shakes, but within bounds."""
    trial = Trial(POLICY, seed=seed)
    trial.session.pipeline.hand_load.set_tool(Tool(MAX_TOOL_KG, np.array([MAX_TOOL_CENTER_M, 0.0, 0.0])))
    for _ in trial.run(replace(DEFAULT_COMMAND, mask=np.array(mask)), 5.0):
        assert np.abs(trial.session.output.hand.force_estimated_n).max() <= 50.0
        assert not trial.fallen


def test_jerks_come_one_after_another() -> None:
    pulses = list(Pull(POLICY, "guidance", 20.0, (0.0, 3.0, 0.0), 0.05, True, seed=1).pulses())
    starts = [start for start, _ in pulses]
    assert len(pulses) == 4 and np.all(np.diff(starts) > pulses[0][1].duration_s)
    assert all(np.allclose(pulse.force_n, [0.0, 20.0, 0.0]) for _, pulse in pulses)
