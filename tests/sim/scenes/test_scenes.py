"""Every scene: loads, leaves the robot standing free, and its objects move as their joints say."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from control.joints import STIFFNESS
from control.paths import ROBOT_MJCF
from control.timing import TICK_S
from sim import scenes
from sim.backends.simulation.wrenches import Pulse
from sim.scenes import board, box, door, valve


class Objects:
    """A scene without drives, for forces on the objects alone."""

    def __init__(self, name: str) -> None:
        self.model = scenes.build(name).model
        self.data = mujoco.MjData(self.model)
        # The robot floats out of the way; no object moves by gravity.
        self.model.opt.gravity[:] = 0.0
        self.data.qpos[2] = 5.0
        mujoco.mj_forward(self.model, self.data)

    def position(self, joint: str) -> float:
        return float(self.data.joint(joint).qpos[0])

    def push(self, joint: str, effort: float, ticks: int) -> None:
        """Constant generalized force on `joint`."""
        for _ in range(ticks):
            self.data.joint(joint).qfrc_applied[0] = effort
            mujoco.mj_step(self.model, self.data)


@pytest.mark.parametrize("name", scenes.SCENE_NAMES)
def test_robot_starts_in_front_and_stands_still(standing, name):
    backend, command = standing(name)
    start = backend.truth()
    for _ in range(1000):
        backend.write(command)
        touching = {backend.model.geom(index).name for index in backend.data.contact.geom.ravel()}
        assert touching <= {"floor", "FL_wheel", "FR_wheel", "RL_wheel", "RR_wheel"}
    truth = backend.truth()
    np.testing.assert_allclose(truth.base_position, start.base_position, atol=5e-3)
    np.testing.assert_allclose(truth.end_effector_position, start.end_effector_position, atol=1e-2)
    np.testing.assert_allclose(truth.object_positions, start.object_positions, atol=1e-3)
    assert truth.object_positions.shape == (len(backend.movable_bodies), 3)
    assert np.abs(backend.data.qvel).max() < 0.02


@pytest.mark.parametrize("name", scenes.SCENE_NAMES)
def test_primitives_describe_every_geom_that_is_not_the_robots(name):
    scene = scenes.build(name)
    bodies = [scene.model.body(index).name for index in scene.model.geom_bodyid]
    assert len(scene.primitives) == sum(body not in scene.robot_bodies for body in bodies)
    assert {primitive.body for primitive in scene.primitives} <= {"world", *scene.movable_bodies}
    assert len({primitive.name for primitive in scene.primitives}) == len(scene.primitives)
    for primitive in scene.primitives:
        geom = scene.model.geom(primitive.name)
        np.testing.assert_array_equal(primitive.size, geom.size)
        np.testing.assert_array_equal(primitive.position, geom.pos)
        np.testing.assert_array_equal(primitive.orientation_wxyz, geom.quat)
    assert scene.primitives[0].kind == "plane"


@pytest.mark.parametrize("name", scenes.SCENE_NAMES)
def test_robot_is_the_same_in_every_scene_and_objects_take_none_of_its_defaults(name):
    robot = mujoco.MjModel.from_xml_path(str(ROBOT_MJCF))
    model = scenes.build(name).model
    np.testing.assert_array_equal(model.dof_frictionloss[: robot.nv], robot.dof_frictionloss)
    np.testing.assert_array_equal(model.dof_armature[: robot.nv], robot.dof_armature)
    np.testing.assert_array_equal(
        model.body_mass[[model.body(robot.body(i).name).id for i in range(1, robot.nbody)]], robot.body_mass[1:]
    )
    stated = {"valve_hinge": valve.FRICTION_TORQUE, "door_hinge": 0.3}
    for index in range(robot.njnt, model.njnt):
        joint = model.joint(index)
        assert joint.frictionloss[0] == stated.get(joint.name, 0.0)


def test_builds_are_independent_and_unknown_names_refused():
    first, second = scenes.build("box"), scenes.build("box")
    first.model.body_mass[:] = 0.0
    assert second.model.body_mass.sum() > 20.0
    with pytest.raises(ValueError, match=r"'moon'.*free, box, board, valve, door"):
        scenes.build("moon")


def test_box_is_carried_sideways_by_a_press_of_the_tool(standing):
    """Friction of the ball on the top moves the box along its slide and nowhere else."""
    backend, command = standing("box")
    backend.wrenches.add(Pulse(np.array([0.0, 0.0, -60.0]), duration_s=30.0, ramp_s=0.5))
    for _ in range(600):
        backend.write(command)
    assert backend.truth().object_positions[0, 1] == pytest.approx(0.0, abs=0.01)
    start = backend.truth().object_positions[0]
    backend.wrenches.add(Pulse(np.array([0.0, 12.0, 0.0]), duration_s=30.0, ramp_s=0.2))
    for _ in range(400):
        backend.write(command)
    moved = backend.truth().object_positions[0] - start
    assert moved[1] > 0.01
    np.testing.assert_array_equal(moved[[0, 2]], 0.0)


def test_box_answers_a_sine_force_with_the_amplitude_of_viscous_friction():
    objects = Objects("box")
    omega = 2 * np.pi * 0.2
    travel = []
    for tick in range(5000):
        objects.push("box_slide", 8.0 * np.cos(omega * tick * TICK_S), 1)
        travel.append(objects.position("box_slide"))
    expected = 8.0 / (omega * np.hypot(box.SLIDE_DAMPING, box.MASS_KG * omega))
    assert 0.5 * (max(travel[2500:]) - min(travel[2500:])) == pytest.approx(expected, rel=0.02)
    assert expected == pytest.approx(0.2, abs=0.005)


def test_board_pushes_back_along_its_normal_with_its_own_friction(standing):
    backend, command = standing("board")
    backend.wrenches.add(Pulse(np.array([0.0, 0.0, -60.0]), duration_s=30.0, ramp_s=0.5))
    for _ in range(600):
        backend.write(command)
    ball = backend.model.geom("end_effector").id
    touching = [contact for contact in backend.data.contact if ball in contact.geom]
    assert len(touching) == 1
    np.testing.assert_allclose(np.abs(touching[0].frame[:3]), [0.0, 0.0, 1.0], atol=1e-12)
    assert touching[0].friction[0] == board.FRICTION
    assert backend.truth().end_effector_position[2] == pytest.approx(board.TOP_HEIGHT_M + 0.02, abs=4e-3)


def test_valve_turns_above_its_friction_and_stays_below_it():
    stuck = Objects("valve")
    stuck.push("valve_hinge", 0.5 * valve.FRICTION_TORQUE, 500)
    assert abs(stuck.position("valve_hinge")) < 0.01
    turning = Objects("valve")
    turning.push("valve_hinge", valve.FRICTION_TORQUE + 1.0, 1500)
    speed = float(turning.data.joint("valve_hinge").qvel[0])
    assert speed == pytest.approx(1.0 / valve.DAMPING, rel=0.1)


def test_ball_in_the_valve_cup_turns_it_by_a_force_in_the_plane(standing):
    """The tool, led into the cup by hand, drags the handle from the top towards the robot's left."""
    backend, command = standing("valve")
    soft = replace(command, stiffness=np.where(np.arange(22) >= 16, 2.0, STIFFNESS))
    center = np.array([valve.CUP_BOTTOM_X_M - 0.021, 0.0, valve.CENTER_HEIGHT_M])
    entry = center + [-0.06, 0.0, valve.HANDLE_RADIUS_M]
    for waypoint in (entry, center + [0.0, 0.0, valve.HANDLE_RADIUS_M]):
        _lead_to(backend, soft, waypoint, 700)
    start = backend.data.joint("valve_hinge").qpos[0]
    _lead_to(backend, soft, center + valve.HANDLE_RADIUS_M * np.array([0.0, np.sin(1.2), np.cos(1.2)]), 1500)
    # A positive hinge angle turns the top towards -y.
    assert backend.data.joint("valve_hinge").qpos[0] - start < -0.3
    np.testing.assert_allclose(backend.truth().object_positions[0], [valve.CUP_BOTTOM_X_M + 0.02, 0, valve.CENTER_HEIGHT_M])


def test_latched_door_resists_and_the_pressed_lever_frees_it():
    latched = Objects("door")
    latched.push("door_hinge", 12.0, 500)
    assert latched.position("door_hinge") < 0.03
    freed = Objects("door")
    freed.push("lever_hinge", 1.0, 200)
    assert freed.position("lever_hinge") > 0.4
    for _ in range(700):
        freed.data.joint("lever_hinge").qfrc_applied[0] = 1.0
        freed.push("door_hinge", 8.0, 1)
    assert freed.position("door_hinge") > 0.3


def test_door_closes_by_its_spring():
    objects = Objects("door")
    objects.data.joint("door_hinge").qpos[0] = 1.2
    objects.data.joint("lever_hinge").qpos[0] = 0.6
    for _ in range(2500):
        objects.push("lever_hinge", 1.0, 1)
    assert objects.position("door_hinge") == pytest.approx(0.0, abs=0.03)


def test_door_spring_balances_the_stated_torque():
    objects = Objects("door")
    objects.data.joint("door_hinge").qpos[0] = 0.9
    objects.data.joint("lever_hinge").qpos[0] = 0.6
    balance = door.CLOSER_PRELOAD + 0.9 * door.CLOSER_STIFFNESS
    for _ in range(1500):
        objects.data.joint("lever_hinge").qfrc_applied[0] = 1.0
        objects.push("door_hinge", balance, 1)
    # Dry friction of the hinge holds it within 0.3 / 5 rad of the balance.
    assert objects.position("door_hinge") == pytest.approx(0.9, abs=0.06)


@pytest.mark.parametrize("angle", [0.2, 1.5])
def test_a_door_that_closes_latches_again(angle):
    objects = Objects("door")
    objects.data.joint("door_hinge").qpos[0] = angle
    objects.push("door_hinge", 0.0, 2000)
    assert objects.position("door_hinge") == pytest.approx(0.0, abs=0.01)
    objects.push("door_hinge", 12.0, 500)
    assert objects.position("door_hinge") < 0.03


@pytest.mark.parametrize("name", scenes.SCENE_NAMES)
def test_parameters_are_drawn_within_their_ranges_and_readings_are_numbers(name):
    drawn = scenes.draw(name, 4)
    assert drawn == scenes.draw(name, 4)
    for parameter in scenes.parameters(name):
        assert parameter.minimum <= parameter.drawn[0] <= drawn[parameter.name] <= parameter.drawn[1] <= parameter.maximum
        assert parameter.minimum <= parameter.default <= parameter.maximum
    scene = scenes.build(name, drawn)
    assert dict(scene.values) == drawn
    data = mujoco.MjData(scene.model)
    mujoco.mj_forward(scene.model, data)
    assert all(np.isfinite(reading.read(data)) for reading in scene.readings)


def test_what_is_no_parameter_of_a_scene_is_refused():
    with pytest.raises(ValueError, match=r"'valve' has no parameter 'colour'; it has friction_nm"):
        scenes.build("valve", {"colour": 1.0})
    with pytest.raises(ValueError, match=r"spring_scale is 9\.0; the range is 0\.2 to 2\.5"):
        scenes.build("door", {"spring_scale": 9.0})


def test_padding_gives_way_and_a_rigid_scene_does_not():
    for name, geom in (("board", "board"), ("door", "door"), ("valve", "valve_cup_bottom"), ("box", "box")):
        padded, rigid = scenes.build(name), scenes.build(name, rigid=True)
        assert padded.model.geom(geom).solimp[0] < 0.2 < rigid.model.geom(geom).solimp[0]


def test_parameters_change_what_runs_and_leave_its_state(standing):
    backend, command = standing("valve")
    backend.data.joint("valve_hinge").qpos[0] = 0.7
    backend.set_parameters({"friction_nm": 1.5, "height_m": 0.57})
    joint = backend.model.joint("valve_hinge")
    assert joint.frictionloss[0] == 1.5
    assert backend.readings()["valve_angle_rad"] == 0.7
    assert backend.data.body("valve").xpos[2] == pytest.approx(0.57)
    assert backend.parameters["friction_nm"] == 1.5
    for _ in range(200):
        backend.write(command)
    assert backend.truth().base_position[2] > 0.3
    with pytest.raises(ValueError, match="friction_nm"):
        backend.set_parameters({"friction_nm": -1.0})


def test_the_board_remembers_where_a_pressing_hand_was_until_it_is_put_back(standing):
    backend, command = standing("board")
    assert backend.readings()["wiped_share"] == 0.0
    start = backend.truth().end_effector_position
    backend.set_drag(np.array([*start[:2], board.TOP_HEIGHT_M - 0.2]))
    for tick in range(1500):
        place = board.pattern(0.002 * tick)
        backend.set_drag(np.array([*place, board.TOP_HEIGHT_M - 0.2]))
        backend.write(command)
        backend.readings() if tick % 10 == 0 else None
    assert backend.readings()["wiped_share"] > 0.03
    backend.reset()
    assert backend.readings()["wiped_share"] == 0.0


def _lead_to(backend, command, target: np.ndarray, ticks: int) -> None:
    """Pull the tool towards `target` with the drag spring, moving its anchor there evenly."""
    start = backend.truth().end_effector_position
    for tick in range(ticks):
        backend.set_drag(start + min(1.0, 1.5 * tick / ticks) * (target - start))
        backend.write(command)
