"""The state machine in lockstep with the emulated robot: what is allowed when, and what reaches the wire and the motors."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from control.joints import ARM_SLICE, LEG_SLICE, NOMINAL_POSITION, TORQUE_LIMIT, WHEEL_SLICE
from control.types import JointCommand
from sim.backends.hardware.states import ALLOWED_FROM, DriveState, Request, Trip
from sim.backends.unitree.motors import SLOT_OF_JOINT, UNUSED_SLOTS, used_slots
from sim.backends.unitree.rpc import RpcResponse
from sim.backends.z1.frames import ArmMode
from tests.sim.hardware.hardware_rig import Rig


def test_nothing_is_published_before_the_motors_are_ours(make_rig: Callable[..., Rig]) -> None:
    rig = make_rig(mode="normal")
    rig.run(0.1)
    assert rig.state == DriveState.OBSERVE
    rig.ask(Request.ENGAGE, seconds=3.0)
    assert rig.emulator.base.mode == "normal" and rig.wire.log == []  # lying down first, as the vendor does
    rig.run(5.0, lambda: rig.state == DriveState.DAMPED)
    assert rig.emulator.base.mode == "" and rig.state == DriveState.DAMPED
    assert rig.emulator.base.refused == 0 and rig.damps()


def test_a_robot_that_does_not_release_is_not_engaged(make_rig: Callable[..., Rig]) -> None:
    rig = make_rig(mode="normal")
    rig.run(0.05)
    rig.request, rig.sequence = Request.ENGAGE, 1
    for _ in range(2600):
        rig.tick()
        rig.emulator.base.mode = "normal"  # a program that takes the motors back
    assert rig.state == DriveState.OBSERVE and rig.wire.log == []
    assert "'normal' still owns the motors" in rig.supervisor.message


@pytest.mark.parametrize(
    ("code", "data", "says"),
    [
        (3203, "", "answers with error 3203"),
        (0, "", "names no owner"),
        (0, "[]", "names no owner"),
        (0, '{"form": "0"}', "names no owner"),
        (0, '{"form": "0", "name": null}', "names no owner"),
    ],
)
def test_an_answer_that_names_no_owner_is_no_release(
    make_rig: Callable[..., Rig], monkeypatch: pytest.MonkeyPatch, code: int, data: str, says: str
) -> None:
    rig = make_rig(mode="normal")
    rig.run(0.05)
    monkeypatch.setattr(rig.emulator.base, "_answer", lambda call: RpcResponse(call.service, call.id, call.api_id, code, data))
    rig.ask(Request.ENGAGE, seconds=0.01)
    rig.run(6.0, lambda: not rig.supervisor.engaging)
    assert rig.state == DriveState.OBSERVE and rig.wire.log == [] and not rig.supervisor.engaging
    assert says in rig.supervisor.message


def test_engage_stand_policy_sit_damp_release(rig: Rig, hold_command: JointCommand) -> None:
    ready = rig
    ready.engage()
    ready.stand()
    height = ready.emulator.body.backend.truth().base_position[2]
    assert height > 0.28 and ready.emulator.arm.mode == ArmMode.LOWCMD
    ready.command = hold_command
    ready.ask(Request.START, seconds=0.4, until=DriveState.POLICY)
    ready.run(0.4)
    np.testing.assert_allclose(used_slots(ready.last_command.motor["kp"]), hold_command.stiffness[:16], atol=1e-5)
    np.testing.assert_allclose(ready.emulator.command.stiffness[ARM_SLICE], hold_command.stiffness[ARM_SLICE], rtol=1e-5)
    np.testing.assert_allclose(ready.emulator.command.damping[ARM_SLICE], hold_command.damping[ARM_SLICE], rtol=1e-5)
    ready.ask(Request.SIT, until=DriveState.DAMPED)
    ready.run(0.3)
    assert ready.damps() and ready.emulator.arm.mode == ArmMode.PASSIVE
    assert ready.emulator.body.backend.truth().base_position[2] < 0.22
    sent = len(ready.wire.log)
    ready.ask(Request.RELEASE, seconds=0.1)
    assert ready.state == DriveState.OBSERVE and len(ready.wire.log) == sent


@pytest.mark.parametrize("request_", [r for r in Request if r != Request.NONE])
def test_requests_out_of_place_are_refused_with_a_hint(rig: Rig, request_: Request) -> None:
    rig.run(0.05)
    rig.ask(request_, seconds=0.01)
    if DriveState.OBSERVE in ALLOWED_FROM[request_]:
        assert rig.supervisor.engaging
    else:
        assert rig.state == DriveState.OBSERVE and "refused while OBSERVE" in rig.supervisor.message
        assert rig.wire.log == []


def test_a_dry_run_reaches_every_state_and_sends_nothing(make_rig: Callable[..., Rig], hold_command: JointCommand) -> None:
    rig = make_rig(dry_run=True, mode="normal")
    rig.engage()
    rig.stand()
    rig.command = hold_command
    rig.ask(Request.START, seconds=0.3, until=DriveState.POLICY)
    assert rig.wire.log == [] and rig.emulator.arm.accepted == 0 and rig.emulator.base.mode == "normal"
    assert rig.supervisor.sent is not None  # what it would have sent


def test_every_frame_is_within_torque_limits(ready: Rig, hold_command: JointCommand) -> None:
    wild = replace(hold_command, position=NOMINAL_POSITION + 2.0, stiffness=hold_command.stiffness * 5.0)
    ready.command = wild
    ready.ask(Request.START, seconds=0.02, until=DriveState.POLICY)
    ready.run(0.1)
    frame, motor = ready.robot.frame, ready.last_command.motor
    assert frame is not None
    q, dq = frame.joint_position[:16], frame.joint_velocity[:16]
    kp, kd, tau, qd, dqd = (used_slots(motor[name]) for name in ("kp", "kd", "tau", "q", "dq"))
    predicted = kp * (qd - q) + kd * (dqd - dq) + tau
    assert (np.abs(predicted) <= TORQUE_LIMIT[:16] + 1e-3).all()
    assert (np.abs(ready.emulator.body.frame.joint_torque) <= TORQUE_LIMIT + 1.0).all()
    assert Trip.TORQUE_CLIPPED in ready.supervisor.warnings


def test_unused_slots_never_carry_gains(ready: Rig) -> None:
    motor = ready.last_command.motor
    for name in ("kp", "kd", "tau"):
        assert not motor[name][UNUSED_SLOTS].any()
    assert (motor["q"][UNUSED_SLOTS] > 1e9).all() and (motor["q"][SLOT_OF_JOINT] < 10.0).all()


def test_the_arm_is_taken_over_at_its_measured_pose_with_rising_gains(rig: Rig) -> None:
    rig.engage()
    pose = rig.emulator.body.frame.joint_position[ARM_SLICE].copy()
    rig.ask(Request.STAND, seconds=0.0)
    stiffness, torque = [], []
    for _ in range(100):
        rig.tick()
        if rig.emulator.arm.mode == ArmMode.LOWCMD:
            stiffness.append(rig.emulator.command.stiffness[ARM_SLICE][0])
            torque.append(np.abs(rig.emulator.body.frame.joint_torque[ARM_SLICE]).max())
    assert stiffness[0] == 0.0 and (np.diff(stiffness) >= -1e-6).all() and 10.0 < stiffness[-1] < 60.0
    assert max(torque) < 12.0
    np.testing.assert_allclose(rig.emulator.body.frame.joint_position[ARM_SLICE], pose, atol=0.1)


def test_wheels_carry_no_stiffness_and_bounded_targets(ready: Rig) -> None:
    motor = ready.last_command.motor
    assert not used_slots(motor["kp"])[WHEEL_SLICE].any()
    assert (used_slots(motor["kp"])[LEG_SLICE] > 0).all()


def test_standing_still_is_not_rest(ready: Rig) -> None:
    ready.run(1.0)
    assert not ready.supervisor.at_rest  # once damped it will fall: whoever waits for rest must go on damping
    ready.ask(Request.DAMP, seconds=0.3)
    assert not ready.supervisor.at_rest
    ready.run(5.0, lambda: ready.supervisor.at_rest)
    assert ready.supervisor.at_rest and ready.emulator.body.backend.truth().base_position[2] < 0.25


def test_a_fault_latches_and_clears_only_at_rest(ready: Rig) -> None:
    ready.operator_silent_s = 5.0
    ready.run(0.01)
    assert ready.state == DriveState.FAULT and ready.damps()
    ready.operator_silent_s = 0.0
    ready.ask(Request.CLEAR, seconds=0.01)  # still falling
    assert ready.state == DriveState.FAULT and "still moving" in ready.supervisor.message
    ready.run(3.0)
    ready.ask(Request.CLEAR, until=DriveState.DAMPED)
    assert ready.supervisor.faults == Trip.NONE
