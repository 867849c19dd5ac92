"""Arrows show forces to scale, in the world's axes, and never on top of each other."""

import numpy as np
import pytest
import viser

from control.frames import rotation_from_quaternion
from web.force_arrows import METERS_PER_NEWTON, SHOWN_FROM_N, Arrows, ForceArrows, sideways
from web.theme import COMMANDED, SHOWN_SIGMAS
from web.uncertainty_cone import spread

DIRECTIONS = np.vstack([np.eye(3), -np.eye(3), [[1, 1, 1], [1, -1, 0], [0.2, 0.9, -0.4]]])


@pytest.fixture
def arrows(server: viser.ViserServer) -> ForceArrows:
    return ForceArrows(server)


def segment(arrows: Arrows) -> np.ndarray:
    assert arrows.visible
    return np.asarray(arrows.points[0])


def test_an_arrow_is_the_force_to_scale_turned_from_heading_to_world(arrows: ForceArrows, snapshot: np.void) -> None:
    snapshot["heading_yaw"] = np.pi / 2
    snapshot["force_estimated_n"] = [10.0, 0.0, 0.0]
    arrows.update(snapshot)
    start, end = segment(arrows.arrows["estimated"])
    np.testing.assert_allclose(start, snapshot["end_effector_position_in_world"], atol=1e-6)
    np.testing.assert_allclose(end - start, [0.0, 10.0 * METERS_PER_NEWTON, 0.0], atol=1e-6)


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_equal_forces_stand_side_by_side(arrows: ForceArrows, snapshot: np.void, direction: np.ndarray) -> None:
    force = 15.0 * direction / np.linalg.norm(direction)
    snapshot["force_estimated_n"] = snapshot["force_true_n"] = snapshot["applied_command"]["force_n"] = force
    snapshot["applied_command"]["mask"] = 1
    arrows.update(snapshot)
    starts = np.array([segment(arrows.arrows[name])[0] for name in ("commanded", "estimated", "true")])
    gaps = np.diff(starts, axis=0)
    assert np.linalg.norm(gaps, axis=1) == pytest.approx(np.linalg.norm(sideways(force)), abs=1e-6)
    assert np.abs(gaps @ force).max() < 1e-5
    assert np.linalg.norm(gaps, axis=1).min() > 0.015


def test_only_force_axes_have_a_commanded_force(arrows: ForceArrows, snapshot: np.void) -> None:
    snapshot["applied_command"]["force_n"] = [8.0, 0.0, 20.0]
    snapshot["applied_command"]["mask"] = [0, 0, 1]
    arrows.update(snapshot)
    start, end = segment(arrows.arrows["commanded"])
    np.testing.assert_allclose(end - start, [0.0, 0.0, 20.0 * METERS_PER_NEWTON], atol=1e-6)


@pytest.mark.parametrize("force", [[np.nan] * 3, [0.0, 0.0, 0.9 * SHOWN_FROM_N]])
def test_unknown_and_negligible_forces_are_not_drawn(arrows: ForceArrows, snapshot: np.void, force: list[float]) -> None:
    arrows.update(snapshot)
    assert arrows.arrows["true"].visible
    snapshot["force_true_n"] = force
    arrows.update(snapshot)
    assert not arrows.arrows["true"].visible


def test_nothing_is_drawn_without_a_live_snapshot(arrows: ForceArrows, snapshot: np.void) -> None:
    arrows.others.enabled = True
    snapshot["force_sigma_n"] = 0.5
    arrows.update(snapshot)
    arrows.hide()
    assert not any(each.visible for each in (*arrows.arrows.values(), arrows.others, arrows.uncertainty.mesh))


def test_the_other_estimates_show_on_demand_beside_each_other(arrows: ForceArrows, snapshot: np.void) -> None:
    snapshot["estimator_names"][:4] = [b"gmo_pi", b"adaptive", b"tcn", b"hybrid"]
    snapshot["force_estimates_n"] = np.nan
    snapshot["force_estimates_n"][[0, 1, 3]] = [[0.0, 0.0, 8.0], [0.0, 0.0, 10.0], [0.0, 0.0, 12.0]]
    arrows.update(snapshot)
    assert not arrows.others.visible
    arrows.others.enabled = True
    arrows.update(snapshot)
    assert arrows.others.visible
    lengths = arrows.others.points[:, 1] - arrows.others.points[:, 0]
    shown = arrows.others.points[:, 0, 2] > 0.0
    assert shown.tolist() == [True, False, False, True, False, False, False]
    np.testing.assert_allclose(lengths[shown], METERS_PER_NEWTON * np.array([[0, 0, 8.0], [0, 0, 12.0]]), atol=1e-6)
    starts = np.vstack([segment(arrows.arrows["true"])[0], arrows.others.points[shown, 0]])
    assert np.linalg.norm(np.diff(starts, axis=0), axis=1).min() > 0.01


def test_the_cone_is_as_wide_as_the_estimate_is_uncertain(arrows: ForceArrows, snapshot: np.void) -> None:
    cone = arrows.uncertainty.mesh
    snapshot["heading_yaw"] = np.pi / 2
    snapshot["force_estimated_n"], snapshot["force_sigma_n"] = [10.0, 0.0, 0.0], [0.5, 3.0, 3.0]
    arrows.update(snapshot)
    assert cone.visible
    radius, height = SHOWN_SIGMAS * 3.0 * METERS_PER_NEWTON, (10.0 + SHOWN_SIGMAS * 0.5) * METERS_PER_NEWTON
    np.testing.assert_allclose(cone.scale, [radius, radius, height])
    axis = rotation_from_quaternion(np.asarray(cone.wxyz)) @ [0.0, 0.0, 1.0]
    np.testing.assert_allclose(axis, [0.0, 1.0, 0.0], atol=1e-6)
    np.testing.assert_allclose(cone.position, snapshot["end_effector_position_in_world"])


@pytest.mark.parametrize("sigma", [np.nan, 1.0])
def test_an_estimate_without_sigma_or_size_has_no_cone(arrows: ForceArrows, snapshot: np.void, sigma: float) -> None:
    snapshot["force_sigma_n"] = sigma
    if np.isfinite(sigma):
        snapshot["force_estimated_n"] = 0.1
    arrows.update(snapshot)
    assert not arrows.uncertainty.mesh.visible


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_the_spread_is_that_of_the_normal_distribution(direction: np.ndarray) -> None:
    sigma = np.array([0.4, 1.0, 2.5])
    unit = direction / np.linalg.norm(direction)
    along, across = spread(7.0 * unit, sigma)
    covariance = np.diag(sigma**2)
    sideways_basis = np.linalg.svd(unit[None])[2][1:]
    assert along**2 == pytest.approx(unit @ covariance @ unit)
    assert across**2 == pytest.approx(np.mean([each @ covariance @ each for each in sideways_basis]))
    assert spread(3.0 * unit, np.full(3, 0.7)) == pytest.approx((0.7, 0.7))


def test_a_switched_off_group_stays_hidden(server: viser.ViserServer) -> None:
    arrows = Arrows(server, "/test_arrows", [COMMANDED], 0.01)
    arrows.enabled = False
    arrows.draw(np.zeros((1, 3)), np.ones((1, 3)), np.array([True]))
    assert not arrows.visible


def test_what_the_controller_estimates_itself_stands_beside_the_others(arrows: ForceArrows, snapshot: np.void) -> None:
    snapshot["force_estimated_n"] = [0.0, 0.0, 10.0]
    snapshot["force_of_controller_n"] = np.nan
    arrows.update(snapshot)
    assert not arrows.of_controller.visible
    snapshot["force_of_controller_n"] = [0.0, 0.0, 12.0]
    arrows.update(snapshot)
    start, end = segment(arrows.of_controller)
    np.testing.assert_allclose(end - start, [0.0, 0.0, 12.0 * METERS_PER_NEWTON], atol=1e-6)
    assert min(np.linalg.norm(start - segment(each)[0]) for each in arrows.arrows.values() if each.visible) > 0.01
