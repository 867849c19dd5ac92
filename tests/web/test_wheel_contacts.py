"""Friction cones and wheel forces."""

import numpy as np
import pytest
import viser
from hypothesis import given
from hypothesis import strategies as st

from control.joints import WHEEL_FRICTION
from web.cone_mesh import cone_mesh
from web.theme import CONE, CONE_EXCEEDED
from web.wheel_contacts import METERS_PER_NEWTON, WheelContacts, outside_cone

finite = st.floats(-200.0, 200.0)


def test_a_cone_stands_on_its_apex() -> None:
    vertices, faces = cone_mesh(0.3, 0.5)
    rim = vertices[1:]
    np.testing.assert_allclose(np.hypot(rim[:, 0], rim[:, 1]), 0.3)
    np.testing.assert_allclose(rim[:, 2], 0.5)
    assert not vertices[0].any()
    assert (np.sort(np.unique(faces)) == np.arange(len(vertices))).all()


@given(finite, finite, st.floats(0.1, 200.0), st.floats(0.1, 10.0))
def test_being_outside_the_cone_does_not_depend_on_scale(x: float, y: float, z: float, scale: float) -> None:
    force = np.array([[x, y, z]])
    ratio = np.hypot(x, y) / z
    if abs(ratio - WHEEL_FRICTION) > 1e-6:
        assert outside_cone(force)[0] == outside_cone(scale * force)[0] == (ratio > WHEEL_FRICTION)


def test_a_slipping_wheel_changes_its_cone_only(server: viser.ViserServer, snapshot: np.void) -> None:
    contacts = WheelContacts(server)
    snapshot["wheel_force_estimated_n"][2] = [40.0, 0.0, 30.0]
    contacts.update(snapshot)
    colors = contacts.cones.batched_colors
    assert [tuple(color) for color in colors] == [CONE, CONE, CONE_EXCEEDED, CONE]


def test_wheels_in_the_air_have_neither_force_nor_cone(server: viser.ViserServer, snapshot: np.void) -> None:
    contacts = WheelContacts(server)
    snapshot["wheel_in_contact"][0] = False
    contacts.update(snapshot)
    lengths = np.linalg.norm(np.diff(contacts.estimated.points, axis=1)[:, 0], axis=1)
    assert lengths == pytest.approx([0.0] + [45.0 * METERS_PER_NEWTON] * 3, abs=1e-6)
    scales = np.asarray(contacts.cones.batched_scales)
    assert scales[0] < 1e-3
    np.testing.assert_allclose(scales[1:], 1.0)


def test_truth_that_is_not_available_is_not_drawn(server: viser.ViserServer, snapshot: np.void) -> None:
    contacts = WheelContacts(server)
    snapshot["wheel_force_true_n"] = np.nan
    contacts.update(snapshot)
    assert contacts.estimated.visible
    assert not contacts.true.visible
