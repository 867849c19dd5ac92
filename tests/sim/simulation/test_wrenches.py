"""External wrenches: exact impulse, frames, application point, superposition, life times, stiff virtual springs."""

import mujoco
import numpy as np
import pytest

from control.timing import TICK_S
from sim.backends.simulation.applied_wrenches import MAX_SOURCES, AppliedWrenches
from sim.backends.simulation.pulses import BODY, HEADING, WORLD, profile_integral
from sim.backends.simulation.wrenches import FRAMES, BodyState, Pulse, Spring

CENTER_OF_MASS = np.array([0.05, -0.02, 0.03])
_FLOATING = f"""
<mujoco>
  <option timestep="{TICK_S}" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <body name="base" pos="0 0 5"><freejoint/><geom type="box" size=".2 .1 .05" mass="4"/></body>
    <body name="end_effector" pos="0 0 1">
      <freejoint/>
      <inertial pos="0.05 -0.02 0.03" mass="0.8" diaginertia="0.004 0.006 0.008"/>
    </body>
  </worldbody>
</mujoco>
"""


class World:
    """Two bodies that float freely, with the sources that act on them."""

    def __init__(self) -> None:
        self.model = mujoco.MjModel.from_xml_string(_FLOATING)
        self.data = mujoco.MjData(self.model)
        self.body = self.model.body("end_effector").id
        mujoco.mj_forward(self.model, self.data)
        self.sources = AppliedWrenches(self.model, self.data)

    def run(self, ticks: int) -> np.ndarray:
        """Force (ticks, 3) applied on the end effector per tick."""
        forces = np.zeros((ticks, 3))
        for tick in range(ticks):
            self.sources.apply()
            forces[tick] = self.data.xfrc_applied[self.body, :3]
            mujoco.mj_step(self.model, self.data)
            mujoco.mj_kinematics(self.model, self.data)
            mujoco.mj_comPos(self.model, self.data)
            mujoco.mj_comVel(self.model, self.data)
        return forces

    def momentum(self) -> tuple[np.ndarray, np.ndarray]:
        """Linear momentum, and angular momentum about the centre of mass, of the end effector, in world."""
        twist = np.zeros(6)
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, self.body, twist, 0)
        rotation = self.data.ximat[self.body].reshape(3, 3)
        inertia = rotation @ np.diag(self.model.body_inertia[self.body]) @ rotation.T
        return self.model.body_mass[self.body] * twist[3:], inertia @ twist[:3]


@pytest.fixture
def world() -> World:
    return World()


@pytest.mark.parametrize(
    ("duration_s", "ramp_s"), [(0.1, 0.0), (0.1, 0.03), (0.1013, 0.0007), (0.0011, 0.0), (0.0005, 0.00025)]
)
def test_a_floating_body_gains_exactly_the_impulse(world, duration_s, ramp_s):
    force = np.array([3.0, -2.0, 5.0])
    world.sources.add(Pulse(force, duration_s=duration_s, ramp_s=ramp_s, frame="world", point_m=CENTER_OF_MASS))
    world.run(80)
    linear, angular = world.momentum()
    np.testing.assert_allclose(linear, force * (duration_s - ramp_s), rtol=1e-9)
    np.testing.assert_allclose(angular, 0.0, atol=1e-9)
    assert world.sources.list() == ()


def test_the_moment_is_that_of_the_application_point(world):
    force, torque, arm = np.array([0.0, 4.0, 0.0]), np.array([0.01, 0.0, 0.02]), np.array([0.2, 0.0, 0.0])
    world.sources.add(Pulse(force, duration_s=TICK_S, torque_nm=torque, frame="world", point_m=CENTER_OF_MASS + arm))
    world.run(1)
    linear, angular = world.momentum()
    # The body has turned a little within the tick, hence the tolerance.
    np.testing.assert_allclose(linear, force * TICK_S, atol=1e-5)
    np.testing.assert_allclose(angular, (np.cross(arm, force) + torque) * TICK_S, atol=1e-6)


def test_profile_integral_matches_quadrature():
    times = np.linspace(0.0, 0.6, 6001)
    level = np.interp(times, [0.0, 0.2, 0.3, 0.5, 0.6], [0.0, 1.0, 1.0, 0.0, 0.0])
    area = np.concatenate([[0.0], np.cumsum(0.5 * (level[1:] + level[:-1]) * np.diff(times))])
    np.testing.assert_allclose([profile_integral(time, 0.5, 0.2) for time in times], area, atol=1e-7)


def test_sources_add_up_and_each_expires_by_itself(world):
    first = Pulse(np.array([1.0, 0.0, 0.0]), duration_s=20 * TICK_S, frame="world")
    second = Pulse(np.array([0.0, 2.0, 0.0]), duration_s=10 * TICK_S, frame="world")
    world.sources.add(first)
    before = world.run(5)
    world.sources.add(second)
    after = world.run(25)
    expected = np.zeros((30, 3))
    expected[:20, 0] += 1.0
    expected[5:15, 1] += 2.0
    np.testing.assert_allclose(np.concatenate([before, after]), expected, atol=1e-9)


def test_many_overlapping_pulses_lose_nothing(world):
    """Sum of impulses with random starts, lengths and ramps that fall between ticks."""
    random = np.random.default_rng(2)
    impulse = np.zeros(3)
    for _ in range(120):
        for _ in range(random.integers(0, 3)):
            force, duration = random.normal(0, 5, 3), random.uniform(1e-4, 0.08)
            ramp = random.uniform(0, 0.5) * duration
            world.sources.add(Pulse(force, duration_s=duration, ramp_s=ramp, frame="world", point_m=CENTER_OF_MASS))
            impulse += force * (duration - ramp)
        world.run(1)
    world.run(60)
    np.testing.assert_allclose(world.momentum()[0], impulse, atol=1e-9)


def test_as_many_as_are_allowed_act_as_the_sum_of_each_alone() -> None:
    """In every frame, at random points and moments, on a robot that moves and turns."""
    random = np.random.default_rng(3)
    pulses = [
        Pulse(
            random.normal(0, 1, 3),
            duration_s=random.uniform(0.01, 0.2),
            torque_nm=random.normal(0, 0.1, 3),
            point_m=random.normal(0, 0.2, 3),
            body=("base", "end_effector")[number % 2],
            frame=FRAMES[number % 3],
            ramp_s=0.005 * (number % 2),
        )
        for number in range(MAX_SOURCES)
    ]
    together = World()
    for pulse in pulses:
        together.sources.add(pulse)
    for _ in range(4):
        together.run(7)
        expected = np.zeros_like(together.data.xfrc_applied)
        for pulse in pulses:
            alone = World()
            alone.data.qpos[:], alone.data.qvel[:] = together.data.qpos, together.data.qvel
            alone.data.time = 0.0
            mujoco.mj_forward(alone.model, alone.data)
            alone.sources.add(pulse)
            alone.data.time = together.data.time
            alone.sources.apply()
            expected += alone.data.xfrc_applied
        together.sources.apply()
        assert expected.any()
        np.testing.assert_allclose(together.data.xfrc_applied, expected, atol=1e-12)


def test_remove_ends_one_source_and_only_that(world):
    kept = world.sources.add(Pulse(np.array([1.0, 0.0, 0.0]), duration_s=1.0, frame="world"))
    gone = world.sources.add(Pulse(np.array([0.0, 1.0, 0.0]), duration_s=1.0, frame="world"))
    world.run(3)
    assert [active.id for active in world.sources.list()] == [kept, gone]
    assert world.sources.list()[0].remaining_s == pytest.approx(1.0 - 3 * TICK_S)
    world.sources.remove(gone)
    np.testing.assert_array_equal(world.run(1)[0], [1.0, 0.0, 0.0])
    with pytest.raises(KeyError, match=str(gone)):
        world.sources.remove(gone)
    assert world.sources.add(Pulse(np.ones(3), duration_s=1.0)) not in (kept, gone)


@pytest.mark.parametrize(
    ("frame", "expected"), [("world", [1.0, 0.0, 0.0]), ("heading", [0.0, 1.0, 0.0]), ("body", [0.0, 0.0, -1.0])]
)
def test_frames_of_a_force(world, frame, expected):
    """The base is turned left by 90 deg (heading) and rolled; the end effector is pitched down by 90 deg (body)."""
    half = np.sqrt(0.5)
    yaw, roll = np.array([half, 0, 0, half]), np.array([np.cos(0.2), np.sin(0.2), 0, 0])
    mujoco.mju_mulQuat(world.data.qpos[3:7], yaw, roll)
    world.data.qpos[10:14] = [half, 0, half, 0]
    mujoco.mj_forward(world.model, world.data)
    world.sources.add(Pulse(np.array([1.0, 0.0, 0.0]), duration_s=1.0, frame=frame))
    np.testing.assert_allclose(world.run(1)[0], expected, atol=1e-12)


def test_frames_are_numbered_alike() -> None:
    assert [FRAMES[index] for index in (WORLD, HEADING, BODY)] == ["world", "heading", "body"]


def test_spring_is_the_virtual_pd_force_of_the_paper():
    """f = Kp (x_d - x) - Kd v, with the anchor in world or in the heading frame."""
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    state = BodyState(
        time_s=0.0,
        period_s=TICK_S,
        point=np.array([0.3, 0.2, 0.5]),
        velocity=np.array([0.1, -0.2, 0.3]),
        rotation_body_to_world=np.eye(3),
        rotation_heading_to_world=turn,
        heading_origin=np.array([1.0, 2.0, 0.0]),
    )
    fixed = Spring(np.array([0.4, 0.1, 0.7]), stiffness=np.array([100.0, 0.0, 50.0]), damping=np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(fixed.wrench(state, 0.0)[0], [100 * 0.1 - 0.1, 0.4, 50 * 0.2 - 0.9])
    riding = Spring(np.array([0.5, 0.0, 0.5]), stiffness=np.array([100.0, 0.0, 0.0]), damping=0.0, frame="heading")
    # In the heading frame the point is (-1.8, 0.7, 0.5); the spring pulls along heading x, which is world y.
    np.testing.assert_allclose(riding.wrench(state, 0.0)[0], [0.0, 100 * 2.3, 0.0])
    capped = Spring(np.array([10.0, 0.2, 0.5]), stiffness=150.0, damping=0.0, limit_n=40.0)
    np.testing.assert_allclose(capped.wrench(state, 0.0)[0], [40.0, 0.0, 0.0])


def test_spring_with_heading_anchor_rides_with_the_base(world):
    world.sources.add(Spring(np.array([0.0, 0.0, 1.0]), stiffness=100.0, damping=0.0, frame="heading"))
    world.data.qpos[0] = 0.25
    mujoco.mj_forward(world.model, world.data)
    np.testing.assert_allclose(world.run(1)[0], [25.0, 0.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("damping_ratio", [0.0, 0.2, 0.8])
def test_stiff_spring_on_the_arm_stays_stable(standing, damping_ratio):
    """1500 N/m, the stiffest of training, at 2 ms: the tip comes to rest near the anchor, which is 2 cm away."""
    backend, command = standing()
    anchor = backend.truth().end_effector_position + [0.0, 0.01, -0.02]
    damping = damping_ratio * np.sqrt(1500.0)
    backend.wrenches.add(Spring(anchor, stiffness=1500.0, damping=damping))
    speed = []
    for _ in range(1000):
        before = backend.truth().end_effector_position
        backend.write(command)
        speed.append(np.abs(backend.truth().end_effector_position - before).max() / TICK_S)
    assert max(speed[-100:]) < 0.05
    np.testing.assert_allclose(backend.truth().end_effector_position, anchor, atol=0.015)


def test_a_spring_of_limited_duration_ends(world):
    world.sources.add(Spring(np.array([1.0, 0.0, 1.0]), stiffness=1.0, damping=0.0, duration_s=4 * TICK_S))
    forces = world.run(6)
    assert (forces[:4, 0] > 0.9).all()
    np.testing.assert_array_equal(forces[4:], 0.0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"force_n": [1.0, np.nan, 0.0]}, "force_n"),
        ({"torque_nm": [1.0, 0.0]}, "torque_nm"),
        ({"frame": "base"}, "world, heading, body"),
        ({"duration_s": 0.0}, "duration_s"),
        ({"duration_s": np.nan}, "duration_s"),
        ({"ramp_s": 0.6}, "ramp_s"),
    ],
)
def test_a_wrong_pulse_is_refused_by_name(change, message):
    with pytest.raises(ValueError, match=message):
        Pulse(**{"force_n": [1.0, 0.0, 0.0], "duration_s": 1.0, **change})


def test_an_unknown_body_and_too_many_sources_are_refused(world):
    with pytest.raises(ValueError, match="base, end_effector"):
        world.sources.add(Pulse(np.ones(3), duration_s=1.0, body="gripper"))
    for _ in range(MAX_SOURCES):
        world.sources.add(Pulse(np.ones(3), duration_s=1.0))
    with pytest.raises(ValueError, match=str(MAX_SOURCES)):
        world.sources.add(Pulse(np.ones(3), duration_s=1.0))
