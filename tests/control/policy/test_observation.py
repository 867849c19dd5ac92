"""Layout and content of observations, and the memory behind them."""

import numpy as np
import pytest

from control.command.command_record import COMMAND
from control.joints import NOMINAL_BASE_HEIGHT_M, NOMINAL_POSITION
from control.policy.observation import EXTENDED_FORM, MEMORYLESS_FORM, PAPER_FORM, Observation, advance_phase
from control.timing import CONTROL_PERIOD_S
from control.whole_body.task_memory import TASK_MEMORY, TaskMemory, TaskMemoryConfig
from control.whole_body.task_signals import TASK_SIGNALS, force_error, position_error


def signals(count: int = 1, **changes: object) -> np.ndarray:
    """Robots at rest in the nominal posture, hand on its reference; changes of signals or of the command, by name."""
    state = np.zeros(count, TASK_SIGNALS)
    values = {
        "gravity": (0.0, 0.0, -1.0),
        "joint_position": NOMINAL_POSITION,
        "base_height": NOMINAL_BASE_HEIGHT_M,
        "orientation_wxyz": (1.0, 0.0, 0.0, 0.0),
        "position_m": (0.55, 0.0, 0.5),
        "hand_position": (0.55, 0.0, 0.5),
    }
    for name, value in (values | changes).items():
        target = state["command"] if name in (COMMAND.names or ()) else state
        target[name] = value
    return state


def assemble(form: str, state: np.ndarray, memory: TaskMemory | None = None) -> tuple[Observation, np.ndarray]:
    observation = Observation(form)
    memories = np.zeros(1, TASK_MEMORY) if memory is None else memory.values
    return observation, observation.assemble(state, memories, np.zeros((1, 22)), np.zeros(1))[0]


def test_the_paper_observes_89_numbers():
    observation, values = assemble(PAPER_FORM, signals())
    assert observation.size == len(values) == 89
    assert sum(part.stop - part.start for part in observation.groups.values()) == 89


def test_the_extended_form_begins_with_the_paper():
    paper, extended = assemble(PAPER_FORM, signals())[1], assemble(EXTENDED_FORM, signals())[1]
    assert np.array_equal(extended[:89], paper)


def test_the_memoryless_form_is_the_extended_one_without_memory():
    """What a memory has gathered changes nothing that it sees."""
    state, memory = signals(hand_position=(0.5, 0.02, 0.5)), TaskMemory(TaskMemoryConfig())
    for _ in range(50):
        memory.step(state)
    extended, everything = assemble(EXTENDED_FORM, state, memory)
    form, seen = assemble(MEMORYLESS_FORM, state, memory)
    assert list(form.groups) == [name for name in extended.groups if name in form.groups]
    for name, part in form.groups.items():
        np.testing.assert_array_equal(seen[part], everything[extended.groups[name]])
    np.testing.assert_array_equal(seen, assemble(MEMORYLESS_FORM, state)[1])
    assert not np.array_equal(everything, assemble(EXTENDED_FORM, state)[1])


def test_unknown_form_is_refused_by_name():
    with pytest.raises(ValueError, match="magic"):
        Observation("magic")


def test_at_rest_on_the_reference_only_gravity_orientation_and_phase_are_seen():
    observation, values = assemble(EXTENDED_FORM, signals())
    seen = {name for name, part in observation.groups.items() if np.abs(values[part]).max() > 1e-6}
    assert seen == {"gravity", "orientation_command", "gait_phase"}


def test_opposite_quaternions_look_the_same():
    orientation = np.array([0.6, 0.0, 0.8, 0.0])
    one = assemble(PAPER_FORM, signals(orientation_wxyz=orientation))[1]
    other = assemble(PAPER_FORM, signals(orientation_wxyz=-orientation))[1]
    assert np.array_equal(one, other)


def test_values_are_clipped():
    values = assemble(PAPER_FORM, signals(force_estimated_n=np.full(3, 1e6)))[1]
    assert np.abs(values).max() == 8.0


CHANGES = {
    "angular_velocity": {"angular_velocity"},
    "gravity": {"gravity"},
    "base_linear_velocity": {"base_linear_velocity", "velocity_error"},
    "base_height": {"base_height"},
    "yaw_rate": {"velocity_error"},
    "joint_position": {"leg_position", "arm_position"},
    "joint_velocity": {"leg_velocity", "wheel_velocity", "arm_velocity"},
    "joint_torque": set(),
    "hand_position": {"position_error"},
    "orientation_error": {"orientation_error"},
    "force_estimated_n": {"force_estimate", "force_error"},
    "mask": {"mask", "position_error", "force_error"},
    "force_n": {"force_command", "force_error"},
    "position_m": {"position_command", "position_error"},
    "orientation_wxyz": {"orientation_command"},
    "base_velocity": {"base_velocity_command", "velocity_error"},
}
REMEMBERED = (
    "reference_velocity",
    "position_integral",
    "force_integral",
    "yaw_integral",
    "wheel_hold",
    "steering_traction",
)


def changed_groups(observation: Observation, one: np.ndarray, other: np.ndarray) -> set[str]:
    """Parts in which two observations differ."""
    return {name for name, part in observation.groups.items() if (one[part] != other[part]).any()}


@pytest.mark.parametrize("name", CHANGES)
def test_every_part_lies_where_its_group_says(name: str):
    random = np.random.default_rng(0)
    base = {"mask": 0.5, "force_n": 3.0, "force_estimated_n": 5.0, "hand_position": (0.5, 0.1, 0.4)}
    before = signals(**base)
    source = before["command"] if name in (COMMAND.names or ()) else before
    after = signals(**base | {name: source[name][0] + random.uniform(0.01, 0.1, source[name][0].shape)})
    observation = Observation(EXTENDED_FORM)
    nothing = np.zeros(1, TASK_MEMORY), np.zeros((1, 22)), np.zeros(1)
    one, other = (observation.assemble(state, *nothing)[0] for state in (before, after))
    assert changed_groups(observation, one, other) == CHANGES[name]


def test_memory_action_and_phase_lie_where_their_groups_say():
    observation, state = Observation(EXTENDED_FORM), signals()
    nothing = np.zeros(1, TASK_MEMORY), np.zeros((1, 22)), np.zeros(1)
    plain = observation.assemble(state, *nothing)[0]
    for name in REMEMBERED:
        memory = np.zeros(1, TASK_MEMORY)
        memory[name] = 0.1
        assert changed_groups(observation, plain, observation.assemble(state, memory, *nothing[1:])[0]) == {name}
    acted = observation.assemble(state, nothing[0], np.ones((1, 22)), nothing[2])[0]
    assert changed_groups(observation, plain, acted) == {"previous_action"}
    later = observation.assemble(state, *nothing[:2], np.ones(1))[0]
    assert changed_groups(observation, plain, later) == {"gait_phase"}


def test_robots_of_a_batch_do_not_see_each_other():
    random = np.random.default_rng(0)
    state = signals(5, force_estimated_n=random.standard_normal((5, 3)), joint_velocity=random.standard_normal((5, 22)))
    memory, actions, phases = TaskMemory(TaskMemoryConfig(), 5), random.standard_normal((5, 22)), random.random(5)
    memory.step(state)
    batch = Observation(EXTENDED_FORM).assemble(state, memory.values, actions, phases)
    for row in range(5):
        alone, one = TaskMemory(TaskMemoryConfig()), slice(row, row + 1)
        alone.step(state[one])
        assert np.array_equal(
            batch[one], Observation(EXTENDED_FORM).assemble(state[one], alone.values, actions[one], phases[one])
        )


def test_errors_belong_to_their_axes():
    state = signals(
        mask=(0.0, 0.0, 1.0), position_m=(0.65, 0.1, 0.9), force_n=(5.0, 5.0, 20.0), force_estimated_n=(1.0, 1.0, 18.0)
    )
    assert np.allclose([position_error(state[0], axis) for axis in range(3)], [0.1, 0.1, 0.0])
    assert np.allclose([force_error(state[0], axis) for axis in range(3)], [0.0, 0.0, -2.0])


def test_integrals_grow_to_their_limits_and_end_with_the_mode():
    memory = TaskMemory(TaskMemoryConfig())
    off = signals(position_m=(0.65, 0.0, 0.5))
    memory.step(off)
    assert memory.values["position_integral"][0, 0] == pytest.approx(0.1 * CONTROL_PERIOD_S)
    for _ in range(200):
        memory.step(off)
    assert memory.values["position_integral"][0, 0] == pytest.approx(TaskMemoryConfig().position_limit_ms)
    memory.step(signals(position_m=(0.65, 0.0, 0.5), mask=(1.0, 0.0, 0.0)))
    assert memory.values["position_integral"][0, 0] == 0.0


def test_reference_velocity_starts_at_zero_and_follows_the_reference():
    memory = TaskMemory(TaskMemoryConfig())
    memory.step(signals())
    assert not memory.values["reference_velocity"].any()
    memory.step(signals(position_m=(0.55, 0.002, 0.5)))
    assert np.allclose(memory.values["reference_velocity"], [0.0, 0.1, 0.0])


def test_wheels_are_held_while_standing_only():
    memory = TaskMemory(TaskMemoryConfig())
    rolled = NOMINAL_POSITION.copy()
    rolled[12:16] = 0.3
    memory.step(signals())
    memory.step(signals(joint_position=rolled))
    assert np.allclose(memory.values["wheel_hold"], -0.3)
    memory.step(signals(joint_position=rolled, base_velocity=(0.2, 0.0, 0.0)))
    assert not memory.values["wheel_hold"].any()
    memory.step(signals(joint_position=rolled))
    assert not memory.values["wheel_hold"].any()


def test_reset_of_some_robots_leaves_the_others():
    memory = TaskMemory(TaskMemoryConfig(), 2)
    memory.step(signals(2, position_m=(0.65, 0.0, 0.5)))
    memory.reset(np.array([0]))
    assert np.array_equal(memory.values[:1], np.zeros(1, TASK_MEMORY))
    assert memory.values["position_integral"][1].any()


def test_phase_turns_at_its_frequency():
    phase = np.zeros(1)
    for _ in range(100):  # two seconds at 1.5 Hz: three turns
        phase = advance_phase(phase)
    assert min(phase[0], 2 * np.pi - phase[0]) == pytest.approx(0.0, abs=1e-9)
