"""Tool and tare: the model that carries a load, the motion that finds it, and when taring is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from control.command.limits import DEFAULT_COMMAND
from control.hand_load.tool import Tool, ToolError
from control.joints import JOINT_COUNT, NOMINAL_POSITION
from control.robot_model import GRAVITY_MPS2, RobotModel
from control.whole_body.body_terms import body_terms
from sim.runtime.session import SessionError
from sim.runtime.simulation import Simulation, SimulationConfig

CENTER_M = np.array([0.05, 0.0, 0.02])


def nominal(model: RobotModel) -> RobotModel:
    model.update(np.eye(3), NOMINAL_POSITION, np.zeros(3), np.zeros(3), np.zeros(JOINT_COUNT))
    return model


def test_a_model_that_carries_a_tool_weighs_it_where_it_is() -> None:
    model = nominal(RobotModel())
    gravity, arm, total, mass = model.gravity.copy(), model.arm_gravity.copy(), model.total_mass, 0.8
    offset = model.end_effector_rotation @ CENTER_M
    jacobian = model.end_effector_jacobian
    upward = jacobian[:3].T @ [0.0, 0.0, GRAVITY_MPS2 * mass] + jacobian[3:].T @ np.cross(
        offset, [0.0, 0.0, GRAVITY_MPS2 * mass]
    )
    model.carry(mass, CENTER_M)
    nominal(model)
    np.testing.assert_allclose(model.gravity - gravity, upward, atol=1e-9)
    np.testing.assert_allclose(model.arm_gravity - arm, upward, atol=1e-9)
    assert model.total_mass == pytest.approx(total + mass)
    model.carry(0.0, np.zeros(3))
    nominal(model)
    np.testing.assert_allclose(model.gravity, gravity, atol=1e-9)


def test_a_load_without_an_inert_lever_weighs_the_same_and_is_inert_at_the_hand() -> None:
    model, mass = nominal(RobotModel()), 1.3
    bare, velocity = model.mass_matrix.copy(), np.random.default_rng(1).normal(size=JOINT_COUNT)
    terms = {}
    for inert in (True, False):
        model.carry(mass, CENTER_M, inert_lever=inert)
        nominal(model)
        terms[inert] = model.gravity.copy(), model.arm_gravity.copy(), model.center_of_mass, -model.momentum_drift.copy()
    for one, other in zip(terms[True], terms[False], strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9)
    linear = model.end_effector_jacobian[:3]
    upper = np.triu(np.ones_like(bare, dtype=bool))
    np.testing.assert_allclose((model.mass_matrix - bare)[upper], (mass * linear.T @ linear)[upper], atol=1e-9)
    model.update(np.eye(3), NOMINAL_POSITION, np.zeros(3), np.zeros(3), velocity)
    assert model.load_lever.tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize(("mass", "center"), [(-0.1, CENTER_M), (9.0, CENTER_M), (1.0, np.full(3, 2.0)), (1.0, np.zeros(2))])
def test_no_hand_carries_that(mass: float, center: np.ndarray) -> None:
    with pytest.raises(ToolError, match=r"range|within"):
        Tool(mass, center)


def settled(payload_kg: float) -> Simulation:
    session = Simulation(SimulationConfig(seed=5))
    session.set_mismatch(1.0, payload_kg=payload_kg, payload_center_m=(0.0, 0.0, -0.05))
    for _ in range(1000):
        session.tick(DEFAULT_COMMAND)
    return session


@pytest.mark.slow
def test_the_motion_finds_the_tool_and_its_weight_is_no_force_any_more() -> None:
    session = settled(payload_kg=1.5)
    assert session.output.hand.force_estimated_n[2] < -8.0
    session.identify_tool()
    while (load := session.pipeline.hand_load.state("hybrid")).identifying is not None:
        session.tick(DEFAULT_COMMAND)
    assert load.tool.mass_kg == pytest.approx(1.5, abs=0.2)
    np.testing.assert_allclose(load.tool.center_of_mass_m, [0.0, 0.0, -0.05], atol=0.03)
    for _ in range(1500):
        session.tick(DEFAULT_COMMAND)
    assert abs(session.output.hand.force_estimated_n[2]) < 2.5
    session.tare()
    tared = [session.tick(DEFAULT_COMMAND).hand.force_estimated_n for _ in range(100)]
    np.testing.assert_allclose(np.mean(tared, axis=0), 0.0, atol=0.8)
    session.reset()
    assert not session.pipeline.hand_load.offset("hybrid").any()
    assert session.pipeline.hand_load.state("hybrid").tool.mass_kg > 1.0


def test_another_command_ends_the_motion_and_a_pressing_hand_is_not_tared() -> None:
    session = settled(payload_kg=0.0)
    session.identify_tool()
    for _ in range(50):
        session.tick(DEFAULT_COMMAND)
    pressing = replace(DEFAULT_COMMAND, mask=np.array([0.0, 0.0, 1.0]), force_n=np.array([0.0, 0.0, 5.0]))
    for _ in range(30):
        session.tick(pressing)
    load = session.pipeline.hand_load.state("hybrid")
    assert load.identifying is None
    assert "another command" in load.message
    for refused in (session.tare, session.identify_tool):
        with pytest.raises(SessionError, match="mask"):
            refused()
    session.reset()
    session.tick(DEFAULT_COMMAND)
    with pytest.raises(SessionError, match="just begun"):
        session.tare()


@pytest.mark.parametrize("mounted", [True, False])
def test_a_tool_that_the_hand_does_not_read_is_doubted(mounted: bool) -> None:
    session = settled(payload_kg=1.5 if mounted else 0.0)
    session.set_tool(1.5, [0.0, 0.0, -0.05])
    assert ("is the tool mounted as told?" in session.pipeline.hand_load.state("hybrid").message) is not mounted
    session.set_tool(1.4, [0.0, 0.0, -0.05])
    assert session.pipeline.hand_load.state("hybrid").message == ""


@pytest.mark.parametrize("mounted", [True, False])
def test_the_lever_of_a_heavy_tool_is_inert_once_the_hand_has_weighed_it(mounted: bool) -> None:
    session = settled(payload_kg=1.5 if mounted else 0.0)
    session.set_tool(1.5, [0.0, 0.0, -0.05])
    model = session.pipeline.model
    assert not model.load_lever.any()
    for _ in range(1500):
        session.tick(DEFAULT_COMMAND)
    assert model.load_lever.any() == mounted
    session.set_tool(0.3, [0.0, 0.0, -0.05])
    assert model.load_lever.any(), "a light tool makes no wrist shake"


def test_a_weight_that_nobody_has_told_of_is_not_tared() -> None:
    session = settled(payload_kg=2.5)
    for _ in range(200):
        session.tick(DEFAULT_COMMAND)
    with pytest.raises(SessionError, match=r"more than a bias|varies"):
        session.tare()


def test_rate_feedback_does_not_grow_with_a_tool_that_may_not_be_there() -> None:
    model, rng = RobotModel(), np.random.default_rng(3)
    for _ in range(5):
        rotation = Rotation.from_rotvec(0.2 * rng.normal(size=3)).as_matrix()
        state = rotation, NOMINAL_POSITION + 0.3 * rng.normal(size=JOINT_COUNT), np.zeros(3), np.zeros(3), np.zeros(JOINT_COUNT)
        model.carry(0.0, np.zeros(3))
        model.update(*state)
        bare = body_terms(model)["arm_inertia"]
        model.carry(3.0, rng.uniform(-0.3, 0.3, 3))
        model.update(*state)
        np.testing.assert_allclose(body_terms(model)["arm_inertia"], bare, atol=1e-9)


def up(session: Simulation) -> float:
    """Cosine of the trunk's tilt."""
    _, x, y, _ = session.truth().base_orientation_wxyz
    return 1.0 - 2.0 * (x * x + y * y)


@pytest.mark.slow
def test_a_heavy_tool_that_is_not_there_does_not_fell_the_robot() -> None:
    session, rng = Simulation(SimulationConfig(seed=8)), np.random.default_rng(7)
    session.set_tool(2.0, [0.3, 0.3, 0.3])
    for _ in range(15):
        ahead = np.array([rng.uniform(-0.4, 0.4), 0.0, 0.0])
        mask, force = rng.integers(0, 2, 3).astype(float), rng.uniform(-20.0, 20.0, 3)
        for _ in range(100):
            session.tick(replace(DEFAULT_COMMAND, mask=mask, force_n=force, base_velocity=ahead))
        assert up(session) > np.cos(np.radians(20.0))


@pytest.mark.slow
def test_a_robot_that_begins_with_a_tool_that_is_not_there_bears_a_push() -> None:
    session = Simulation(SimulationConfig(seed=2))
    session.set_tool(3.0, [0.3, 0.0, 0.3])
    session.reset()
    for push in ([-5.0, 13.0, -12.0], [4.0, 9.0, -6.0], [0.0, 0.0, 0.0]):
        session.add_wrench(force_n=push, body="end_effector", frame="heading", duration_s=1.0, ramp_s=0.2)
        for _ in range(300):
            session.tick(DEFAULT_COMMAND)
            assert up(session) > np.cos(np.radians(10.0))
