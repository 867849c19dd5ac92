"""A push test drives the operator's own calls, and ends with whatever comes between."""

import threading
import time
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND
from server.errors import InvalidFieldError, RefusedError
from server.operator import Operator
from server.push_test import ALL_AROUND, PushTest
from sim.runtime.snapshot import SNAPSHOT, Mode
from web.push_test import PushTestStatus

TICK_S = 1.0
"""Simulated time between two looks: the robot below lives fast."""


class Robot:
    """An operator whose robot stands, or lies once it is pulled to the left."""

    def __init__(self) -> None:
        self.record = np.zeros(1, SNAPSHOT)[0]
        self.record["backend"], self.record["scene"] = b"simulation", b"free"
        self.asked: list[dict[str, Any]] = [{}]
        self.wrenches: list[dict[str, Any]] = []
        self.resets = 0
        self.before_look: Callable[[], None] = lambda: None
        self.client = SimpleNamespace(
            require_alive=lambda: None,
            require_snapshot=lambda: self.record,
            live_snapshot=self.look,
            estops=SimpleNamespace(pending=False),
        )
        self.stand()

    def stand(self) -> None:
        self.record["time_s"] = 0.0
        self.record["base_position"], self.record["base_orientation_wxyz"] = [0.0, 0.0, 0.36], [1.0, 0.0, 0.0, 0.0]

    def look(self) -> np.void:
        self.before_look()
        self.record["time_s"] += TICK_S
        self.record["command_sequence"] = len(self.asked)
        return self.record.copy()

    def command(self) -> tuple[Any, int]:
        return DEFAULT_COMMAND, len(self.asked)

    def patch_command(self, **fields: Any) -> tuple[Any, int]:
        self.asked.append(fields)
        return self.command()

    def reset(self, seed: int | None = None) -> None:
        self.resets += 1
        self.stand()
        self.asked.append({})

    def add_wrench(self, **fields: Any) -> int:
        self.wrenches.append(fields)
        if fields["force_n"][1] > 0 and fields["force_n"][0] == fields["force_n"][2] == 0:
            self.record["base_position"][2] = 0.1
        return len(self.wrenches)

    def remove_wrench(self, key: int) -> None:
        assert key <= len(self.wrenches)


@pytest.fixture
def robot() -> Robot:
    return Robot()


@pytest.fixture
def pushing(robot: Robot) -> PushTest:
    return PushTest(cast(Operator, robot))


def finished(pushing: PushTest) -> PushTestStatus:
    deadline = time.monotonic() + 120.0
    while (status := pushing.status()).running:
        assert time.monotonic() < deadline
        time.sleep(0.01)
    return status


def test_it_pulls_from_all_around_counts_falls_and_restores_the_command(robot: Robot, pushing: PushTest) -> None:
    pushing.start("guidance", 20.0, 8)
    status = finished(pushing)
    assert status.message == "The test is done."
    assert [each.direction for each in status.done] == [d for d in ALL_AROUND if d[2] == 0.0]
    assert [each.direction for each in status.done if each.fell] == [(0.0, 1.0, 0.0)]
    np.testing.assert_allclose([np.linalg.norm(each["force_n"]) for each in robot.wrenches], 20.0)
    assert robot.resets == 9  # before each, and after the last
    assert [each["guidance"] for each in robot.asked if each] == [True] * 8 + [False]


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ("estop", "the e-stop was pressed"),
        ("scene", "another scene or robot was chosen"),
        ("command", "something else was commanded"),
        ("reset", "the simulation was reset"),
        ("dead", "the control process does not answer"),
        ("cancel", "it was cancelled"),
    ],
)
def test_it_ends_with_what_comes_between(robot: Robot, pushing: PushTest, what: str, words: str) -> None:
    pulling = threading.Event()

    def between() -> None:
        if not robot.wrenches or pulling.is_set():
            return
        pulling.set()
        if what == "estop":
            robot.record["mode"] = Mode.ESTOP
        elif what == "scene":
            robot.record["scene"] = b"box"
        elif what == "command":
            robot.patch_command(force_n=[0.0, 0.0, 5.0])
        elif what == "reset":
            robot.record["time_s"] = 0.0
        elif what == "dead":
            robot.client.live_snapshot = lambda: None
        else:
            pushing.cancel()

    robot.before_look = between
    pushing.start("zero_force", 10.0, 26)
    status = finished(pushing)
    assert words in status.message and len(robot.wrenches) == 1
    if what == "command":
        assert robot.asked[-1] == {"force_n": [0.0, 0.0, 5.0]}  # somebody's command stays
    elif what == "cancel":
        assert robot.asked[-1]["mask"] == [0, 0, 0]


def test_it_is_refused_where_it_cannot_run(robot: Robot, pushing: PushTest) -> None:
    for arguments, words in (
        (("float", 20.0, 8), "guidance"),
        (("guidance", 500.0, 8), "1 to 60 N"),
        (("guidance", 20.0, 9), "8, 26"),
    ):
        with pytest.raises(InvalidFieldError, match=words):
            pushing.start(*arguments)
    robot.record["mode"] = Mode.PAUSED
    with pytest.raises(RefusedError, match="does not run"):
        pushing.start("guidance", 20.0, 8)
    robot.record["mode"], robot.record["backend"] = Mode.RUNNING, b"hardware"
    with pytest.raises(RefusedError, match="simulation only"):
        pushing.start("guidance", 20.0, 8)
