"""Every fault injected at the emulated robot or the control side, and what reached the motors afterwards."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from control.joints import JOINT_NAMES, TORQUE_LIMIT
from control.timing import TICK_S
from control.types import JointCommand
from sim.backends.hardware.io.loop import IoLoop
from sim.backends.hardware.records import IoMemory
from sim.backends.hardware.states import DriveState, Request, Trip
from sim.emulator.base_board import COMMAND_TIMEOUT_S
from sim.emulator.faults import Faults
from tests.sim.hardware.hardware_rig import Rig


@pytest.fixture
def driving(ready: Rig, hold_command: JointCommand) -> Rig:
    """The robot stands under the control process's commands."""
    ready.command = hold_command
    ready.ask(Request.START, seconds=0.3, until=DriveState.POLICY)
    return ready


def trip(rig: Rig, seconds: float) -> float:
    """Seconds until the fault latches; asserts that from then on only damping is sent and the motors obey it."""
    ticks = rig.run(seconds, lambda: rig.state == DriveState.FAULT)
    assert rig.state == DriveState.FAULT, (rig.state, rig.supervisor.warnings)
    assert rig.damps()
    rig.run(0.05)
    assert rig.state == DriveState.FAULT and rig.damps()
    return ticks * TICK_S


def motors_only_damp(rig: Rig) -> bool:
    command = rig.emulator.command
    return not command.stiffness.any() and not command.torque.any() and bool((command.damping > 0).all())


def test_frozen_states(driving: Rig) -> None:
    driving.emulator.faults.freeze = True
    delay = trip(driving, 0.2)
    assert driving.config.limits.state_damp_s < delay <= driving.config.limits.state_damp_s + 0.006
    assert driving.supervisor.faults & Trip.STALE_STATE
    driving.run(COMMAND_TIMEOUT_S)
    assert motors_only_damp(driving)  # the board hears nothing either: its own time-out damps


def test_a_killed_robot_is_damped_until_it_returns_under_its_own_program(driving: Rig) -> None:
    driving.emulator.faults.kill = True
    delay = trip(driving, 0.2)
    assert driving.config.limits.state_damp_s < delay <= driving.config.limits.state_damp_s + 0.006
    sent = len(driving.wire.log)
    driving.run(2.0)
    assert len(driving.wire.log) == sent + 1000 and driving.damps()
    driving.wire.commands.clear()  # nobody was there to take them
    driving.restart("normal")
    sent = len(driving.wire.log)
    driving.run(0.1)
    assert driving.supervisor.faults & Trip.RESTARTED
    assert len(driving.wire.log) == sent and driving.emulator.base.refused == 0
    driving.ask(Request.CLEAR, until=DriveState.OBSERVE)
    driving.ask(Request.ENGAGE, until=DriveState.DAMPED)
    assert driving.emulator.base.mode == "" and driving.damps()


def test_an_error_of_our_own_damps(driving: Rig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(now: float) -> bool:
        raise OSError("broken")

    loop = IoLoop(driving.config, driving.robot, driving.supervisor, IoMemory(tmp_path / "memory", create=True))
    sent = len(driving.wire.log)
    with monkeypatch.context() as error:
        error.setattr(driving.robot, "poll", broken)
        for _ in range(10):
            driving.emulator.step()
            loop.tick(driving.now)
    assert driving.supervisor.faults == Trip.INTERNAL
    assert len(driving.wire.log) == sent + 10 and driving.damps() and motors_only_damp(driving)
    driving.emulator.step()
    loop.tick(driving.now)
    assert driving.state == DriveState.FAULT and driving.damps()


@pytest.mark.parametrize("joint", ["FL_calf", "RR_wheel"])
def test_nan_in_a_state_never_reaches_a_motor(driving: Rig, joint: str) -> None:
    driving.emulator.faults.nan = joint
    assert trip(driving, 0.1) <= 2 * TICK_S
    assert driving.supervisor.faults == Trip.NOT_FINITE and driving.supervisor.message.endswith(f": {joint}")
    assert np.isfinite(driving.last_command.data).all() and motors_only_damp(driving)


def test_nan_of_the_arm_is_refused_as_a_frame(driving: Rig) -> None:
    driving.emulator.faults.nan = "arm_joint3"
    trip(driving, 0.2)
    assert driving.supervisor.faults & Trip.STALE_ARM and driving.robot.arm.bad_frames > 10


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("position", np.nan),
        ("torque", np.inf),
        ("stiffness", -1.0),
        ("stiffness", 1e300),
        ("damping", np.nan),
        ("velocity", -np.inf),
    ],
)
def test_unsound_commands_are_rejected_and_latch(driving: Rig, hold_command: JointCommand, field: str, value: float) -> None:
    wrong = getattr(hold_command, field).copy()
    wrong[4] = value
    driving.command = replace(hold_command, **{field: wrong})
    assert trip(driving, 0.1) == TICK_S
    assert driving.supervisor.faults == Trip.NOT_FINITE and motors_only_damp(driving)


def test_a_command_of_the_wrong_shape_is_rejected(driving: Rig, hold_command: JointCommand) -> None:
    driving.command = replace(hold_command, position=np.zeros(21))
    trip(driving, 0.1)
    assert "position must have shape (22,)" in driving.supervisor.message


def test_lost_messages_are_counted_and_survived(driving: Rig, hold_command: JointCommand) -> None:
    driving.emulator.faults.drop = 0.1
    driving.run(1.0)
    assert driving.state == DriveState.POLICY and 30 < driving.robot.base.missed < 80
    np.testing.assert_allclose(driving.emulator.command.stiffness, hold_command.stiffness, rtol=1e-5)


def test_flipped_bits_are_refused_and_survived(driving: Rig) -> None:
    accepted = driving.emulator.base.accepted
    driving.emulator.faults.bit_flip = 0.2
    driving.run(1.0)
    base = driving.emulator.base
    assert driving.robot.base.bad_samples > 50 and base.bad_commands > 50
    assert base.accepted - accepted + base.bad_commands == pytest.approx(500, abs=2)
    assert driving.state == DriveState.POLICY  # none of it counted as a state or moved a motor
    assert (np.abs(driving.emulator.body.frame.joint_torque) <= TORQUE_LIMIT).all()


def test_every_message_flipped_is_silence(driving: Rig) -> None:
    driving.emulator.faults.bit_flip = 1.0
    trip(driving, 0.2)
    assert driving.supervisor.faults & (Trip.STALE_STATE | Trip.STALE_ARM)


def test_delay_and_jitter(driving: Rig) -> None:
    driving.emulator.faults.delay_s, driving.emulator.faults.jitter_s = 0.004, 0.004
    driving.run(0.5)
    assert driving.state == DriveState.POLICY and driving.robot.base.missed < 60
    driving.emulator.faults.delay_s = 0.2
    trip(driving, 0.3)
    assert motors_only_damp(driving)


@pytest.mark.parametrize("joint", ["FR_thigh", "FR_wheel", "arm_joint2"])
def test_overheating_sits_down_then_damps(driving: Rig, joint: str) -> None:
    driving.emulator.faults.overheat, driving.emulator.faults.overheat_rate = joint, 150.0
    temperature = lambda: driving.robot.temperature()[JOINT_NAMES.index(joint)]  # noqa: E731
    driving.run(1.0, lambda: Trip.TEMPERATURE in driving.supervisor.warnings)
    assert 64.0 < temperature() < 70.0
    driving.run(1.0, lambda: driving.state == DriveState.SITTING)
    assert 69.0 < temperature() < 71.0 and driving.supervisor.message.endswith(f"hot: {joint}")
    driving.run(1.0, lambda: driving.state != DriveState.SITTING)
    assert driving.damps()
    driving.run(0.01)
    assert motors_only_damp(driving)


def test_a_low_battery_warns_and_sits(driving: Rig) -> None:
    driving.emulator.faults.battery_percent = 20
    driving.run(0.02)
    assert driving.state == DriveState.POLICY and Trip.BATTERY in driving.supervisor.warnings
    driving.emulator.faults.battery_percent = 12
    driving.run(0.02)
    assert driving.state == DriveState.SITTING
    driving.run(3.0, lambda: driving.state == DriveState.DAMPED)
    driving.run(0.01)
    assert driving.state == DriveState.DAMPED and motors_only_damp(driving)


def test_a_second_writer_is_noticed_at_once(driving: Rig) -> None:
    driving.emulator.faults.second_writer = True
    assert trip(driving, 0.5) <= 0.1
    assert driving.supervisor.faults == Trip.FOREIGN_WRITER
    assert not driving.emulator.command.stiffness.any()


@pytest.mark.parametrize("joint", ["RL_calf", "arm_joint2"])
def test_a_stuck_encoder_is_noticed_while_standing_up(rig: Rig, joint: str) -> None:
    rig.engage()
    rig.emulator.faults.stuck_encoder = joint
    rig.ask(Request.STAND, seconds=3.0)
    assert rig.state == DriveState.FAULT and rig.supervisor.faults & (Trip.STUCK_ENCODER | Trip.STAND_UP | Trip.TORQUE)
    assert rig.damps() and motors_only_damp(rig)


def test_the_remote_control_stops(driving: Rig) -> None:
    driving.emulator.faults.remote_stop = True
    assert trip(driving, 0.1) <= 2 * TICK_S
    assert driving.supervisor.faults == Trip.REMOTE_STOP and motors_only_damp(driving)


def test_a_late_command_is_held_then_damped(driving: Rig) -> None:
    driving.command_age_s = 0.08
    driving.run(0.05)
    assert driving.state == DriveState.POLICY and Trip.STALE_COMMAND in driving.supervisor.warnings
    driving.command_age_s = 0.11
    assert trip(driving, 0.05) == TICK_S
    assert driving.supervisor.faults == Trip.STALE_COMMAND


@pytest.mark.parametrize(("side", "reason"), [("silent_s", Trip.STALE_COMMAND), ("operator_silent_s", Trip.STALE_OPERATOR)])
def test_silence_damps_in_every_stiff_state(ready: Rig, side: str, reason: Trip) -> None:
    setattr(ready, side, 2.0)
    assert trip(ready, 0.05) == TICK_S and ready.supervisor.faults == reason


def test_a_fall_damps(driving: Rig) -> None:
    data = driving.emulator.body.backend._data
    data.qpos[3:7] = [np.cos(0.55), np.sin(0.55), 0.0, 0.0]  # rolled by 1.1 rad
    trip(driving, 0.1)
    assert driving.supervisor.faults & Trip.TILT


def test_an_arm_that_leaves_low_level_mode_damps(driving: Rig) -> None:
    driving.emulator.arm.mode = driving.emulator.arm.mode.PASSIVE
    driving.emulator.arm.receive = lambda: None  # and does not come back
    trip(driving, 0.1)
    assert driving.supervisor.faults & Trip.ARM


@pytest.mark.parametrize(
    ("faults", "says"),
    [
        ({"bit_flip": 0.3}, "unsound"),
        ({"battery_percent": 18}, "battery at 18 %"),
        ({"second_writer": True}, "another program"),
        ({"nan": "FL_hip"}, "not finite"),
        ({"drop": 0.8}, "periods between states"),
    ],
)
def test_the_self_test_refuses(make_rig: Callable[..., Rig], faults: dict[str, Any], says: str) -> None:
    rig = make_rig()
    rig.run(0.05)
    rig.emulator.faults.update(faults, JOINT_NAMES)
    rig.ask(Request.ENGAGE, seconds=0.5)
    assert rig.state in (DriveState.OBSERVE, DriveState.DISCONNECTED) and rig.wire.log == []
    assert says in rig.supervisor.message


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"dorp": 1.0}, "no fault 'dorp'"),
        ({"nan": "nose"}, "joints are"),
        ({"freeze": 1}, "must be bool"),
        ({"drop": True}, "float"),
        ({"drop": 2}, "0 to 1"),
        ({"delay_s": float("nan")}, "0 to 10"),
        ({"battery_percent": 300}, "-1 to 100"),
    ],
)
def test_unknown_faults_are_named(changes: dict[str, Any], says: str) -> None:
    faults = Faults()
    with pytest.raises(ValueError, match=says):
        faults.update({"jitter_s": 1.0, **changes}, JOINT_NAMES)
    assert faults.jitter_s == 0.0
