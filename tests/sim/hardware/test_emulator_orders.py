"""What an emulator may be told while it runs."""

import json

import numpy as np
import pytest

from sim import scenes
from sim.backends.simulation.leading_person import PAUSE_S
from sim.backends.simulation.sensors import SensorConfig
from sim.backends.unitree.rpc import MOTION_SWITCHER, MotionSwitcherApi, RpcRequest
from sim.emulator.orders import obey
from sim.emulator.physics import RobotBody
from tests.sim.hardware.hardware_rig import Rig


def refuse(_: str) -> None:
    raise AssertionError("nothing was asked")


def test_a_push_acts_on_the_hand_and_ends(ready: Rig) -> None:
    obey(ready.emulator, json.dumps({"push": {"force_n": [0.0, 0.0, -8.0], "duration_s": 0.1}}), refuse)
    ready.run(0.05)
    truth = ready.emulator.body.backend.truth()
    assert truth.force_true_n[2] == pytest.approx(-8.0, abs=0.1)
    ready.run(0.1)
    assert abs(ready.emulator.body.backend.truth().force_true_n[2]) < 0.1


def test_a_report_says_what_the_motors_were_told(ready: Rig) -> None:
    answers: list[str] = []
    obey(ready.emulator, '{"report": true}', answers.append)
    assert answers == []  # between two steps only
    ready.tick()
    report = json.loads(answers[0])
    assert report["stiffness_max"] > 10.0 and report["damping_min"] > 0.0 and report["base_position_m"][2] > 0.28


def test_faults_are_switched_by_name(ready: Rig) -> None:
    obey(ready.emulator, '{"freeze": true}', refuse)
    assert ready.emulator.faults.freeze


@pytest.mark.parametrize("parameter", ["", "ai", "[]", "{}"])
def test_a_call_that_names_no_mode_is_answered_with_an_error(ready: Rig, parameter: str) -> None:
    ready.wire.requests.append(RpcRequest(MOTION_SWITCHER, 7, MotionSwitcherApi.SELECT_MODE, parameter))
    ready.tick()
    assert [(answer.id, answer.code) for answer in ready.wire.responses] == [(7, 3204)]
    assert ready.emulator.base.mode == ""


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("hello", "Expecting value"),
        ("[1]", "must be a JSON object"),
        ('{"jump": true}', "no fault 'jump'"),
        ('{"push": {"force_n": [1, 2]}}', "push"),
        ('{"lead": {"speed": 1}}', "lead"),
        ('{"push": {"force_n": [1, 2, NaN], "duration_s": 1}}', "force_n"),
    ],
)
def test_what_cannot_be_obeyed_is_named(ready: Rig, line: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        obey(ready.emulator, line, refuse)


def test_somebody_leads_the_hand_for_a_while(ready: Rig) -> None:
    obey(ready.emulator, json.dumps({"lead": {"seed": 1, "duration_s": 10.0}}), refuse)
    ready.run(PAUSE_S + 1.0)
    assert np.linalg.norm(ready.emulator.body.backend.truth().force_true_n[:2]) > 1.0


def test_a_robot_is_switched_on_in_a_scene_and_tells_what_can_be_read_there() -> None:
    body = RobotBody(SensorConfig(), 3, "door", behind_m=0.4)
    assert body.backend.truth().base_position[0] == pytest.approx(-0.4, abs=0.05)
    assert body.backend.parameters == pytest.approx(scenes.draw("door", 3))
    assert set(body.readings) == {"door_angle_rad", "lever_angle_rad"}
