"""Layout and content of observations, and the memory behind them."""

from dataclasses import fields, replace

import numpy as np
import pytest

from control.joints import NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION
from control.policy.observation import EXTENDED_FORM, PAPER_FORM, Observation, advance_phase
from control.policy.task_memory import TaskMemory, TaskMemoryConfig, TaskSignals
from control.timing import CONTROL_PERIOD_S


def signals(**changes: np.ndarray) -> TaskSignals:
    """A robot at rest in the nominal posture, hand on its reference."""
    sizes = {"base_height": 1, "yaw_rate": 1, "joint_position": 22, "joint_velocity": 22, "joint_torque": 22, "orientation": 4}
    values = {field.name: np.zeros(sizes.get(field.name, 3)) for field in fields(TaskSignals)}
    values |= {
        "gravity": np.array([0.0, 0.0, -1.0]),
        "joint_position": NOMINAL_POSITION.copy(),
        "base_height": np.array([NOMINAL_BASE_HEIGHT_M]),
        "orientation": np.array([1.0, 0.0, 0.0, 0.0]),
        "position": np.array([0.55, 0.0, 0.5]),
        "hand_position": np.array([0.55, 0.0, 0.5]),
    }
    return TaskSignals(**{**values, **changes})


def assemble(form: str, state: TaskSignals, memory: TaskMemory | None = None) -> tuple[Observation, np.ndarray]:
    observation = Observation(form)
    memory = memory or TaskMemory(TaskMemoryConfig())
    return observation, observation.assemble(state, memory, np.zeros(22), np.zeros(1))


def test_the_paper_observes_89_numbers():
    observation, values = assemble(PAPER_FORM, signals())
    assert observation.size == len(values) == 89
    assert sum(part.stop - part.start for part in observation.groups.values()) == 89


def test_the_extended_form_begins_with_the_paper():
    paper, extended = assemble(PAPER_FORM, signals())[1], assemble(EXTENDED_FORM, signals())[1]
    assert np.array_equal(extended[:89], paper)


def test_unknown_form_is_refused_by_name():
    with pytest.raises(ValueError, match="magic"):
        Observation("magic")


def test_at_rest_on_the_reference_only_gravity_orientation_and_phase_are_seen():
    observation, values = assemble(EXTENDED_FORM, signals())
    seen = {name for name, part in observation.groups.items() if np.abs(values[part]).max() > 1e-6}
    assert seen == {"gravity", "orientation_command", "gait_phase"}


def test_opposite_quaternions_look_the_same():
    orientation = np.array([0.6, 0.0, 0.8, 0.0])
    one = assemble(PAPER_FORM, signals(orientation=orientation))[1]
    other = assemble(PAPER_FORM, signals(orientation=-orientation))[1]
    assert np.array_equal(one, other)


def test_values_are_clipped():
    values = assemble(PAPER_FORM, signals(force_estimated_n=np.full(3, 1e6)))[1]
    assert np.abs(values).max() == 8.0


def test_a_batch_is_assembled_like_its_robots():
    random = np.random.default_rng(0)
    robots = [signals(force_estimated_n=random.standard_normal(3), joint_velocity=random.standard_normal(22)) for _ in range(5)]
    stacked = TaskSignals(**{f.name: np.stack([getattr(r, f.name) for r in robots]) for f in fields(TaskSignals)})
    batch_memory = TaskMemory(TaskMemoryConfig(), (5,))
    batch_memory.step(stacked)
    batch = Observation(EXTENDED_FORM).assemble(stacked, batch_memory, np.zeros((5, 22)), np.zeros((5, 1)))
    for row, robot in zip(batch, robots, strict=True):
        memory = TaskMemory(TaskMemoryConfig())
        memory.step(robot)
        assert np.array_equal(row, assemble(EXTENDED_FORM, robot, memory)[1])


def test_errors_belong_to_their_axes():
    state = signals(
        mask=np.array([0.0, 0.0, 1.0]),
        position=np.array([0.65, 0.1, 0.9]),
        force=np.array([5.0, 5.0, 20.0]),
        force_estimated_n=np.array([1.0, 1.0, 18.0]),
    )
    assert np.allclose(state.position_error, [0.1, 0.1, 0.0])
    assert np.allclose(state.force_error, [0.0, 0.0, -2.0])


def test_integrals_grow_to_their_limits_and_end_with_the_mode():
    memory = TaskMemory(TaskMemoryConfig())
    off = signals(position=np.array([0.65, 0.0, 0.5]))
    memory.step(off)
    assert memory.position_integral[0] == pytest.approx(0.1 * CONTROL_PERIOD_S)
    for _ in range(200):
        memory.step(off)
    assert memory.position_integral[0] == pytest.approx(TaskMemoryConfig().position_limit_ms)
    memory.step(replace(off, mask=np.array([1.0, 0.0, 0.0])))
    assert memory.position_integral[0] == 0.0


def test_reference_velocity_starts_at_zero_and_follows_the_reference():
    memory = TaskMemory(TaskMemoryConfig())
    memory.step(signals())
    assert not memory.reference_velocity.any()
    memory.step(signals(position=np.array([0.55, 0.002, 0.5])))
    assert np.allclose(memory.reference_velocity, [0.0, 0.1, 0.0])


def test_wheels_are_held_while_standing_only():
    memory = TaskMemory(TaskMemoryConfig())
    rolled = NOMINAL_POSITION.copy()
    rolled[12:16] = 0.3
    memory.step(signals())
    memory.step(signals(joint_position=rolled))
    assert np.allclose(memory.wheel_hold, -0.3)
    memory.step(signals(joint_position=rolled, base_velocity=np.array([0.2, 0.0, 0.0])))
    assert not memory.wheel_hold.any()
    memory.step(signals(joint_position=rolled))
    assert not memory.wheel_hold.any()


def test_reset_of_some_robots_leaves_the_others():
    memory = TaskMemory(TaskMemoryConfig(), (2,))
    state = signals(position=np.array([0.65, 0.0, 0.5]))
    memory.step(TaskSignals(**{f.name: np.stack([getattr(state, f.name)] * 2) for f in fields(TaskSignals)}))
    memory.reset(np.array([0]))
    assert not memory.position_integral[0].any()
    assert memory.position_integral[1].any()


def test_phase_turns_at_its_frequency():
    phase = np.zeros(1)
    for _ in range(100):  # two seconds at 1.5 Hz: three turns
        phase = advance_phase(phase)
    assert min(phase[0], 2 * np.pi - phase[0]) == pytest.approx(0.0, abs=1e-9)
