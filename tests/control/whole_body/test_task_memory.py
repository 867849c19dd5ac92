"""What a task remembers: integrals by mode, the reference's motion, held wheels, and what a still axis lets go."""

import numpy as np
import pytest

from control.joints import WHEEL_SLICE
from control.timing import CONTROL_PERIOD_S
from control.whole_body.task_memory import TASK_MEMORY, TaskMemory, TaskMemoryConfig
from control.whole_body.task_signals import TASK_SIGNALS

CONFIG = TaskMemoryConfig()


def signals(**fields):
    """One robot's; `command_...` goes to the command."""
    record = np.zeros(1, TASK_SIGNALS)
    for name, value in fields.items():
        part, _, field = name.rpartition("command_")
        target = record["command"] if part == "" and field != name else record
        target[field] = value
    return record


def remembered(steps, memory=None):
    memory = memory or TaskMemory(CONFIG)
    for step in steps:
        memory.step(step)
    return memory.values[0]


def test_errors_are_integrated_on_the_axes_of_their_mode_alone_and_within_limits():
    off = signals(
        command_mask=(0.0, 1.0, 1.0),
        command_position_m=(0.02, 0.02, 0.02),
        command_force_n=(9.0, 9.0, -4.0),
        force_estimated_n=(12.0, 12.0, -2.0),
    )
    once = remembered([off])
    assert once["position_integral"] == pytest.approx([0.02 * CONTROL_PERIOD_S, 0.0, 0.0])
    assert once["force_integral"] == pytest.approx([0.0, 3.0 * CONTROL_PERIOD_S, 2.0 * CONTROL_PERIOD_S])
    assert remembered([off] * 2000)["force_integral"] == pytest.approx([0.0, CONFIG.force_limit_ns, CONFIG.force_limit_ns])
    aside = remembered([signals(command_position_m=(0.02, 0.0, -0.02))] * 2000)
    assert aside["position_integral"] == pytest.approx([CONFIG.position_limit_ms, 0.0, -CONFIG.position_limit_ms])


def test_an_integral_is_gone_once_its_axis_changes_mode():
    memory = TaskMemory(CONFIG)
    remembered([signals(command_position_m=0.05)] * 5, memory)
    pressed = signals(command_mask=1.0, command_position_m=0.05, command_force_n=5.0, force_estimated_n=3.0)
    assert not remembered([pressed], memory)["position_integral"].any()
    assert not remembered([signals(command_position_m=0.05)], memory)["force_integral"].any()


def test_a_force_that_has_met_nothing_winds_up_no_integral():
    apart = signals(command_mask=1.0, command_force_n=CONFIG.force_error_limit_n + 0.5)
    assert not remembered([apart] * 100)["force_integral"].any()


def test_the_references_motion_is_its_difference_and_does_not_jump_at_the_start():
    memory = TaskMemory(CONFIG)
    assert not remembered([signals(command_position_m=(0.5, 0.1, 0.4))], memory)["reference_velocity"].any()
    moved = remembered([signals(command_mask=(0.0, 0.0, 1.0), command_position_m=(0.502, 0.1, 0.41))], memory)
    assert moved["reference_velocity"] == pytest.approx([0.002 / CONTROL_PERIOD_S, 0.0, 0.0])


def test_standing_wheels_are_held_where_they_came_to_stand():
    memory = TaskMemory(CONFIG)

    def at(angle, forward):
        record = signals(command_base_velocity=(forward, 0.0, 0.0))
        record["joint_position"][0, WHEEL_SLICE] = angle
        return record

    assert not remembered([at(1.0, 0.3)], memory)["wheel_hold"].any()
    assert not remembered([at(1.5, 0.0)], memory)["wheel_hold"].any()
    assert remembered([at(1.3, 0.0)], memory)["wheel_hold"] == pytest.approx([0.2] * 4)
    assert not remembered([at(1.3, 0.3)], memory)["wheel_hold"].any()
    assert not remembered([at(2.0, 0.0)], memory)["wheel_hold"].any()


def pressing(reference_x):
    """A hand that presses down, and whose reference ahead is somewhere."""
    return signals(
        command_mask=(0.0, 0.0, 1.0),
        command_force_n=(0.0, 0.0, 15.0),
        command_position_m=(reference_x, 0.0, 0.0),
        force_estimated_n=(6.0, 0.0, 15.0),
    )


def test_a_still_axis_of_a_pressing_hand_lets_go_and_holds_again_once_it_is_moved():
    memory = TaskMemory(CONFIG)
    wait = round(CONFIG.still_s / CONTROL_PERIOD_S)
    assert remembered([pressing(0.02)] * wait, memory)["released"][0] == pytest.approx(0.0, abs=1e-9)
    held = float(memory.values["position_integral"][0, 0])
    remembered([pressing(0.02)] * wait, memory)
    released = memory.values[0].copy()
    assert released["released"] == pytest.approx([1.0, 1.0, 0.0])
    step = 0.02 * CONTROL_PERIOD_S
    assert released["position_integral"][0] < held + wait * step
    assert remembered([pressing(0.03)], memory)["released"][0] == 0.0


def test_nothing_is_let_go_by_a_hand_that_does_not_press():
    free = signals(command_position_m=(0.02, 0.0, 0.0), force_estimated_n=(6.0, 0.0, 0.0))
    assert not remembered([free] * 200)["released"].any()


def test_a_hand_asked_for_no_force_rests_where_a_force_last_moved_it():
    memory = TaskMemory(CONFIG)

    def at(x, felt):
        return signals(command_mask=1.0, hand_position=(x, 0.0, 0.5), force_estimated_n=(felt, 0.0, 0.0))

    settle = round(5.0 * CONFIG.felt_s / CONTROL_PERIOD_S)
    remembered([at(0.50, 0.0)], memory)
    led = remembered([at(0.55, 5.0 * CONFIG.rest_force_n)] * settle, memory)
    assert (led["anchor"][0], led["rest"][0]) == (0.50, 0.55)
    left = remembered([at(0.55, 0.0)] * settle + [at(0.56, 0.0)], memory)
    assert (left["anchor"][0], left["rest"][0]) == (0.50, 0.55)
    tracking = remembered([signals(hand_position=(0.58, 0.0, 0.5))], memory)
    assert (tracking["anchor"][0], tracking["rest"][0]) == (0.58, 0.58)


def test_an_estimate_that_is_off_by_less_than_a_touch_moves_nothing_however_noisy_and_long():
    memory, random = TaskMemory(CONFIG), np.random.default_rng(4)
    for step, noise in enumerate(0.3 * CONFIG.rest_force_n * random.standard_normal(3000)):
        felt = -0.7 * CONFIG.rest_force_n + noise
        memory.step(signals(command_mask=1.0, hand_position=(0.5 - 1e-5 * step, 0.0, 0.5), force_estimated_n=(felt, 0.0, 0.0)))
    assert memory.values["rest"][0, 0] == pytest.approx(0.5)
    assert abs(memory.values["force_integral"][0, 0]) < 0.1


def test_what_led_a_hand_is_forgotten_once_nothing_is_felt():
    memory = TaskMemory(CONFIG)
    led = remembered([signals(command_mask=1.0, force_estimated_n=(4.0, 0.0, 0.0))] * 200, memory)
    assert led["force_integral"][0] == pytest.approx(CONFIG.force_limit_ns)
    left = remembered([signals(command_mask=1.0)] * round(10.0 * CONFIG.release_s / CONTROL_PERIOD_S), memory)
    assert left["force_integral"][0] == pytest.approx(0.0, abs=1e-3)


def test_many_robots_remember_as_each_does_alone_and_one_forgets_alone():
    random = np.random.default_rng(5)
    steps = []
    for _ in range(30):
        step = np.zeros(3, TASK_SIGNALS)
        step["command"]["mask"] = random.integers(0, 2, (3, 3))
        step["command"]["force_n"], step["command"]["position_m"] = random.normal(size=(2, 3, 3))
        step["command"]["base_velocity"][:, [0, 2]] = random.normal(size=(3, 2)) * random.integers(0, 2, (3, 1))
        step["force_estimated_n"], step["hand_position"] = random.normal(size=(2, 3, 3))
        step["joint_position"], step["joint_torque"] = random.normal(size=(2, 3, 22))
        steps.append(step)
    together = TaskMemory(CONFIG, 3)
    for step in steps:
        together.step(step)
    for robot in range(3):
        alone = remembered([step[robot : robot + 1] for step in steps])
        assert together.values[robot].tobytes() == alone.tobytes()
    others = together.values[[0, 2]].tobytes()
    together.reset(np.array([1]))
    assert together.values[1] == np.zeros((), TASK_MEMORY)
    assert together.values[[0, 2]].tobytes() == others
