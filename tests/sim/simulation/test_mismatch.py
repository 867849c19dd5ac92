"""Mismatch: scales from nominal, changes nothing else, is refused by name."""

import mujoco
import numpy as np
import pytest

from control.joints import JOINT_NAMES
from sim.backends.simulation.mismatch import Mismatch


def mass_matrix(backend) -> np.ndarray:
    mass = np.zeros((backend.model.nv, backend.model.nv))
    mujoco.mj_crb(backend.model, backend.data)
    mujoco.mj_fullM(backend.model, backend.data, mass)
    return mass


def test_mass_scale_scales_mass_matrix_and_gravity_but_not_armature(standing):
    backend, _ = standing()
    armature = np.diag(backend.model.dof_armature)
    nominal = mass_matrix(backend) - armature
    gravity = backend.data.qfrc_bias.copy()
    backend.set_mismatch(Mismatch(mass_scale=1.25))
    mujoco.mj_forward(backend.model, backend.data)
    np.testing.assert_allclose(mass_matrix(backend) - armature, 1.25 * nominal, atol=1e-12)
    np.testing.assert_allclose(backend.data.qfrc_bias, 1.25 * gravity, atol=1e-9)
    assert backend.mass_scale == pytest.approx(1.25)


def test_changing_it_while_running_leaves_the_state_alone(standing):
    backend, command = standing()
    for _ in range(50):
        backend.write(command)
    data = backend.data
    before = [data.qpos.copy(), data.qvel.copy(), data.time, data.xpos.copy(), data.cvel.copy(), data.qacc_warmstart.copy()]
    backend.set_mismatch(Mismatch(mass_scale=0.8, per_link={"arm_link6": 1.3}))
    after = [data.qpos, data.qvel, data.time, data.xpos, data.cvel, data.qacc_warmstart]
    for old, new in zip(before, after, strict=True):
        np.testing.assert_array_equal(old, new)
    backend.write(command)


def test_scales_are_from_nominal_and_links_multiply(standing):
    backend, _ = standing()
    model = backend.model
    link, other = model.body("arm_link3").id, model.body("base").id
    mass, inertia = model.body_mass.copy(), model.body_inertia.copy()
    for _ in range(3):
        backend.set_mismatch(Mismatch(mass_scale=1.1, per_link={"arm_link3": 1.5}))
    assert model.body_mass[link] == pytest.approx(1.65 * mass[link])
    np.testing.assert_allclose(model.body_inertia[link], 1.65 * inertia[link])
    assert model.body_mass[other] == pytest.approx(1.1 * mass[other])
    backend.set_mismatch(Mismatch())
    np.testing.assert_array_equal(model.body_mass, mass)
    np.testing.assert_array_equal(model.body_inertia, inertia)


def test_objects_of_the_scene_keep_their_mass(standing):
    backend, _ = standing("box")
    backend.set_mismatch(Mismatch(mass_scale=1.5))
    assert backend.model.body_mass[backend.model.body("box").id] == pytest.approx(2.0)


def test_friction_scales(standing):
    backend, _ = standing()
    model = backend.model
    dofs = [model.joint(name).dofadr[0] for name in JOINT_NAMES]
    damping, friction = model.dof_damping[dofs].copy(), model.dof_frictionloss[dofs].copy()
    wheel = model.geom("RL_wheel").friction[0]
    backend.set_mismatch(Mismatch(joint_friction_scale=0.5, ground_friction_scale=1.5))
    np.testing.assert_allclose(model.dof_damping[dofs], 0.5 * damping)
    np.testing.assert_allclose(model.dof_frictionloss[dofs], 0.5 * friction)
    assert model.geom("RL_wheel").friction[0] == pytest.approx(1.5 * wheel)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mass_scale": 0.4}, "mass_scale is 0.4; the range is 0.5 to 1.5"),
        ({"mass_scale": float("nan")}, "mass_scale"),
        ({"per_link": {"base": 2.0}}, r"per_link\['base'\]"),
        ({"joint_friction_scale": -1.0}, "joint_friction_scale"),
    ],
)
def test_a_scale_out_of_range_is_refused_by_name(values, message):
    with pytest.raises(ValueError, match=message):
        Mismatch(**values)


def test_an_unknown_link_is_refused_and_changes_nothing(standing):
    backend, _ = standing("box")
    backend.set_mismatch(Mismatch(mass_scale=1.2))
    with pytest.raises(ValueError, match=r"'box'.*arm_link1"):
        backend.set_mismatch(Mismatch(per_link={"box": 1.1}))
    assert backend.mass_scale == pytest.approx(1.2)
    assert backend.mismatch.mass_scale == 1.2
