"""A task goes on, fails and is aborted by what is felt, and always ends in a hold."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
import pytest

from control.command.limits import DEFAULT_COMMAND, CommandLimits
from control.faults import Fault
from control.frames import rotation_z
from control.timing import CONTROL_PERIOD_S
from control.types import Command, Odometry
from sim.scenes.door import LEVER_HEIGHT_M
from sim.scenes.valve import CENTER_HEIGHT_M, HANDLE_RADIUS_M
from sim.tasks import TASKS, chosen_options, options_of
from sim.tasks.door import GRIPS, NEARER_M
from sim.tasks.runner import BACK_OFF_M, BACK_OFF_S, Outcome, TaskRunner
from sim.tasks.standstill import Standstill
from sim.tasks.task import ZERO_S, Lasting, Option, Phase, RunningMean, TaskRefusedError, require_reach, zeroing
from sim.tasks.view import Site, TaskView

VIEW = TaskView(
    time_s=0.0,
    phase_s=0.0,
    position_m=np.zeros(2),
    yaw_rad=0.0,
    sigma_m=0.0,
    hand_m=np.array([0.6, 0.0, 0.5]),
    hand_in_heading_m=np.array([0.6, 0.0, 0.5]),
    force_n=np.zeros(3),
    force_in_heading_n=np.zeros(3),
    up=1.0,
    faults=Fault.NONE,
    damping=False,
)
PUSH = replace(DEFAULT_COMMAND, mask=np.array([1.0, 0.0, 0.0]), force_n=np.array([-9.0, 0.0, 0.0]))


class Played:
    """A task of given phases."""

    NAME: ClassVar[str] = "played"
    SCENE: ClassVar[str] = ""
    DESCRIPTION: ClassVar[str] = ""
    OPTIONS: ClassVar[Mapping[str, Option]] = {}

    def __init__(self, options: Mapping[str, float], *phases: Phase) -> None:
        self._phases = phases

    def check(self, view: TaskView, limits: CommandLimits) -> None: ...

    def phases(self) -> Iterator[Phase]:
        yield from self._phases

    def metrics(self) -> dict[str, float]:
        return {}

    def plan(self) -> np.ndarray:
        return np.empty((0, 3))


def push(_: TaskView) -> Command:
    return PUSH


def phase(name: str = "push", done: Callable[[TaskView], bool] = lambda _: False, **fields: Any) -> Phase:
    return Phase(name, push, done, **{"limit_s": 1.0, **fields})


def at(time_s: float, force_n: float = 0.0, **fields: Any) -> TaskView:
    """The view at a time, with a force along x."""
    force = np.array([force_n, 0.0, 0.0])
    return replace(VIEW, time_s=time_s, force_n=force, force_in_heading_n=force, **fields)


def holds(command: Command) -> bool:
    return not command.mask.any() and not command.base_velocity.any() and not command.guidance


def test_a_hand_is_tared_once_at_the_end_of_its_rest_and_not_where_that_fails() -> None:
    runner = TaskRunner(Played({}, zeroing(push, until=0.5), phase("press")), VIEW)
    runner.step(at(0.9 * ZERO_S))
    assert runner.phase == "zero" and not runner.tare_due
    runner.step(at(1.01 * ZERO_S))
    assert runner.phase == "press" and runner.tare_due
    held = TaskRunner(Played({}, zeroing(push, until=0.5), phase("press")), VIEW)
    held.step(at(1.01 * ZERO_S, -8.0))
    assert held.phase == "press" and not held.tare_due
    fallen = TaskRunner(Played({}, zeroing(push, until=0.5), phase("press")), VIEW)
    fallen.step(at(0.5 * ZERO_S, damping=True))
    assert fallen.outcome == Outcome.FAILED and not fallen.tare_due


def test_phases_follow_one_another_and_success_is_held() -> None:
    runner = TaskRunner(Played({}, phase("touch", lambda v: v.force_n[0] < -2.0, until=0.5), phase("press")), VIEW)
    assert runner.step(at(0.1)) is PUSH and runner.phase == "touch"
    runner.step(at(0.2, -3.0))
    assert runner.phase == "press" and runner.progress == pytest.approx(0.5)
    runner.step(at(0.7, -3.0))
    assert runner.progress == pytest.approx(0.75)
    command = runner.step(at(1.25, -3.0))
    assert runner.outcome == Outcome.SUCCEEDED and not runner.moving and runner.progress == 1.0
    assert holds(command) and holds(runner.step(at(9.0)))


def test_what_comes_too_late_fails_with_its_reason_and_backs_off_along_the_contact() -> None:
    runner = TaskRunner(Played({}, phase(late="no wall is met")), VIEW)
    runner.step(at(0.5, -8.0))
    command = runner.step(at(1.1, -8.0))
    assert runner.outcome == Outcome.FAILED and runner.reason == "push: no wall is met"
    assert holds(command)
    # The wall pushes the hand back along -x: that is where it goes.
    np.testing.assert_allclose(command.position_m, VIEW.hand_in_heading_m - [BACK_OFF_M, 0.0, 0.0])
    assert runner.moving
    runner.step(at(1.2 + BACK_OFF_S))
    assert not runner.moving and runner.phase == "back off"


def test_what_is_wrong_must_last() -> None:
    def lost(view: TaskView) -> str | None:
        return None if view.force_n[0] < -1.0 else "the contact is lost"

    runner = TaskRunner(Played({}, phase(limit_s=9.0, wrong=lost, patience_s=0.5)), VIEW)
    for time_s, force in ((0.1, -5.0), (0.2, 0.0), (0.6, 0.0), (0.65, -5.0), (0.7, 0.0), (1.1, 0.0)):
        runner.step(at(time_s, force))
    assert runner.outcome == Outcome.RUNNING
    runner.step(at(1.25))
    assert runner.outcome == Outcome.FAILED and runner.reason == "push: the contact is lost"


def test_what_can_be_recovered_from_backs_off_and_goes_on() -> None:
    told: list[str] = []
    runner = TaskRunner(Played({}, phase(late="no wall is met", recover=told.append, until=0.5), phase("again")), VIEW)
    command = runner.step(at(1.1, -8.0))
    assert told == ["push: no wall is met"] and runner.outcome == Outcome.RUNNING
    assert runner.phase == "back off" and holds(command)
    runner.step(at(1.2 + BACK_OFF_S))
    assert runner.phase == "again" and runner.step(at(1.3 + BACK_OFF_S)) is PUSH


@pytest.mark.parametrize(
    ("trouble", "reason"),
    [
        ({"damping": True}, "the drives damp"),
        ({"up": 0.9}, "the robot leans"),
        ({"faults": Fault.STALE_SETPOINT}, "fallen silent"),
    ],
)
def test_trouble_ends_any_task(trouble: dict[str, Any], reason: str) -> None:
    runner = TaskRunner(Played({}, phase(limit_s=9.0, patience_s=0.1)), VIEW)
    runner.step(at(0.1, **trouble))
    runner.step(at(0.3, **trouble))
    assert runner.outcome == Outcome.FAILED and reason in runner.reason


def test_an_aborted_task_backs_off_and_stays_aborted() -> None:
    runner = TaskRunner(Played({}, phase(limit_s=9.0)), VIEW)
    runner.abort(at(0.4, -5.0), "it was aborted")
    assert holds(runner.step(at(0.5)))
    runner.abort(at(0.6), "once more")
    assert (runner.outcome, runner.reason) == (Outcome.ABORTED, "it was aborted")


def test_a_view_from_another_place_commands_the_same_hand() -> None:
    view = replace(VIEW, position_m=np.array([0.3, -0.2]), yaw_rad=0.4, force_n=rotation_z(0.4) @ [1.0, 2.0, 3.0])
    place = Site(-0.4, 0.7, 1.1)
    there = view.seen_from(place)
    point = np.array([[0.6, 0.1, 0.5]])
    np.testing.assert_allclose(there.in_heading(point[0]), view.in_heading(place.in_odometry(point)[0]))
    np.testing.assert_allclose(place.in_odometry(there.hand_m[None])[0], view.hand_m)
    np.testing.assert_allclose(rotation_z(1.1) @ there.force_n, view.force_n)


def test_a_command_of_the_site_is_the_same_in_heading_wherever_the_robot_stands() -> None:
    view = replace(VIEW, position_m=np.array([0.3, -0.2]), yaw_rad=0.4)
    command = view.command(np.array([0.9, 0.1, 0.5]), pitch_rad=0.5, yaw_rad=0.4, force_n=(-3.0, 1.0, 2.0))
    back = rotation_z(0.4) @ command.position_m + [0.3, -0.2, 0.0]
    np.testing.assert_allclose(back, [0.9, 0.1, 0.5])
    np.testing.assert_allclose(rotation_z(0.4) @ command.force_n, [-3.0, 1.0, 2.0])
    np.testing.assert_allclose(command.orientation_wxyz, [np.cos(0.25), 0.0, np.sin(0.25), 0.0], atol=1e-12)
    np.testing.assert_allclose(
        Site(1.0, 2.0, np.pi / 2).in_odometry(np.array([[1.0, 0.0, 0.3]])), [[1.0, 3.0, 0.3]], atol=1e-12
    )


def test_a_contact_must_last() -> None:
    touching = Lasting(0.06)
    assert [touching(at(t), felt) for t, felt in ((0.0, True), (0.04, True), (0.05, False), (0.06, True), (0.12, True))] == [
        False,
        False,
        False,
        False,
        True,
    ]


def test_a_base_at_rest_stays_where_it_was_and_one_that_drives_follows_its_odometry() -> None:
    standstill = Standstill()
    still, driving = np.zeros(3), np.array([0.2, 0.0, 0.0])

    def step(x_m: float, velocity: np.ndarray, time_s: float) -> float:
        return float(standstill.step(Odometry(np.array([x_m, 0.0]), 0.0, 0.0), velocity, time_s)[0])

    assert step(0.01, still, 1.0) == 0.0
    assert step(0.05, driving, 1.02) == pytest.approx(0.04)
    assert step(0.08, still, 1.2) == pytest.approx(0.07)
    assert step(0.30, still, 3.0) == pytest.approx(0.07)
    assert step(0.35, driving, 3.02) == pytest.approx(0.12)


def test_a_mean_of_nothing_is_not_a_number() -> None:
    mean = RunningMean(2)
    assert np.isnan(mean()).all()
    mean.add(np.array([1.0, 4.0]))
    mean.add(np.array([3.0, 0.0]))
    np.testing.assert_array_equal(mean(), [2.0, 2.0])


@pytest.mark.parametrize("name", TASKS)
def test_every_task_says_what_it_takes_and_refuses_what_it_does_not(name: str) -> None:
    options = options_of(name)
    assert {"site_x_m", "site_y_m", "site_yaw_rad"} <= set(options)
    chosen = chosen_options(name, {})
    assert chosen == {key: option.default for key, option in options.items()}
    assert all(option.minimum <= option.default <= option.maximum for option in options.values())
    with pytest.raises(ValueError, match="no option 'speed'"):
        chosen_options(name, {"speed": 1.0})
    with pytest.raises(ValueError, match=r"site_x_m is 99.*-20 to 20 m"):
        chosen_options(name, {"site_x_m": 99.0})
    task = TASKS[name](chosen)
    task.check(VIEW, CommandLimits())
    assert task.plan().shape[1] == 3 and next(iter(task.phases())).limit_s > 0.0
    assert all(isinstance(value, float) for value in task.metrics().values())


@pytest.mark.parametrize(("plan", "reason"), [((0.0, 0.0, 0.0), "empty"), ((3.0, 1.0, 0.0), "door must come last")])
def test_a_plan_that_cannot_be_played_is_refused(plan: tuple[float, float, float], reason: str) -> None:
    options: dict[str, float] = dict(zip(("first", "second", "third"), plan, strict=True))
    with pytest.raises(TaskRefusedError, match=reason):
        TASKS["sequence"](chosen_options("sequence", options)).check(VIEW, CommandLimits())


def test_a_step_of_a_sequence_that_fails_twice_is_left_out_and_told() -> None:
    task = TASKS["sequence"](chosen_options("sequence", {"first": 1.0, "second": 2.0, "third": 0.0}))
    names: list[str] = []
    for phase in task.phases():
        names.append(phase.name)
        assert phase.tares == phase.name.endswith(" zero")
        if phase.name == "valve touch":
            assert phase.recover is not None
            phase.recover("valve touch: no handle is met")
    assert names.count("valve touch") == names.count("valve zero") == 2 and "valve search" not in names
    assert names.index("board wipe") > names.index("come") and names[-1] == "report"
    assert (task.metrics()["steps"], task.metrics()["steps_done"], task.metrics()["tries"]) == (2.0, 1.0, 3.0)


def test_a_valve_is_turned_on_while_the_wheels_creep_aside_but_a_hand_off_its_circle_has_slipped() -> None:
    task = TASKS["valve"](chosen_options("valve", {}))
    place = None
    for phase in task.phases():
        if phase.name == "seat":
            assert phase.done(replace(VIEW, phase_s=2.0, hand_m=np.array([0.69, 0.0, CENTER_HEIGHT_M + HANDLE_RADIUS_M])))
        if phase.name == "place":
            place = phase
            break
    assert place is not None
    view = VIEW
    for time_s in np.arange(0.0, 30.0, CONTROL_PERIOD_S):
        angle, crept = 0.5 * time_s, 0.004 * time_s  # m, more than the hand may be off its circle, and odometry does not tell
        circle = np.array([0.69, HANDLE_RADIUS_M * -np.sin(angle), CENTER_HEIGHT_M + HANDLE_RADIUS_M * np.cos(angle)])
        view = replace(VIEW, time_s=time_s, phase_s=time_s, hand_m=circle + [0.0, crept, 0.0])
        place.command(view)
        assert place.wrong(view) is None
    inwards = np.array([0.0, 0.12, CENTER_HEIGHT_M]) - view.hand_m
    fallen = view.hand_m + 0.08 * inwards / np.linalg.norm(inwards[1:]) * [0.0, 1.0, 1.0]
    assert place.wrong(replace(view, hand_m=fallen)) == "the hand has slipped off the handle"


def test_a_hand_that_slid_off_the_lever_presses_it_again_nearer_to_its_axis_and_not_for_ever() -> None:
    task = TASKS["door"](chosen_options("door", {}))
    low = replace(VIEW, phase_s=2.0, hand_m=np.array([0.52, -0.07, LEVER_HEIGHT_M - 0.3]))
    names, pressed_at = [], []
    for phase in task.phases():
        names.append(phase.name)
        if phase.name == "push":
            break
        if phase.name == "press":
            pressed_at.append(phase.command(low).position_m[1])
            assert phase.done(low) == (len(pressed_at) < GRIPS)
    grip = ["reach", "zero", "touch", "press"]
    assert names == ["approach", *grip, *["back", *grip] * (GRIPS - 1), "push"]
    np.testing.assert_allclose(np.diff(pressed_at), -NEARER_M)


def test_what_is_out_of_reach_is_refused_before_anything_moves() -> None:
    with pytest.raises(TaskRefusedError, match=r"the valve is out of reach.*1\.70.*site_x_m"):
        require_reach("the valve", np.array([[1.7, 0.0, 0.5]]), VIEW, CommandLimits())
    for name in ("wipe", "valve", "box", "door", "sequence"):
        far = replace(VIEW, position_m=np.array([-1.5, 0.0]))
        with pytest.raises(TaskRefusedError):
            TASKS[name](chosen_options(name, {})).check(far, CommandLimits())
