"""Arrows show forces to scale, in the world's axes, and never on top of each other."""

import numpy as np
import pytest
import viser

from web.force_arrows import METERS_PER_NEWTON, SHOWN_FROM_N, Arrows, ForceArrows, sideways
from web.theme import COMMANDED

DIRECTIONS = np.vstack([np.eye(3), -np.eye(3), [[1, 1, 1], [1, -1, 0], [0.2, 0.9, -0.4]]])


@pytest.fixture
def arrows(server: viser.ViserServer) -> ForceArrows:
    return ForceArrows(server)


def segment(arrows: Arrows) -> np.ndarray:
    assert arrows.visible
    return np.asarray(arrows.points[0])


def test_an_arrow_is_the_force_to_scale_turned_from_heading_to_world(arrows: ForceArrows, snapshot: np.void) -> None:
    snapshot["heading_yaw"] = np.pi / 2
    snapshot["force_estimated"] = [10.0, 0.0, 0.0]
    arrows.update(snapshot)
    start, end = segment(arrows.arrows["estimated"])
    np.testing.assert_allclose(start, snapshot["end_effector_position_in_world"], atol=1e-6)
    np.testing.assert_allclose(end - start, [0.0, 10.0 * METERS_PER_NEWTON, 0.0], atol=1e-6)


@pytest.mark.parametrize("direction", DIRECTIONS)
def test_equal_forces_stand_side_by_side(arrows: ForceArrows, snapshot: np.void, direction: np.ndarray) -> None:
    force = 15.0 * direction / np.linalg.norm(direction)
    snapshot["force_estimated"] = snapshot["force_true"] = snapshot["applied_command"]["force_n"] = force
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
    snapshot["force_true"] = force
    arrows.update(snapshot)
    assert not arrows.arrows["true"].visible


def test_nothing_is_drawn_without_a_live_snapshot(arrows: ForceArrows, snapshot: np.void) -> None:
    arrows.update(snapshot)
    arrows.hide()
    assert not any(each.visible for each in arrows.arrows.values())


def test_a_switched_off_group_stays_hidden(server: viser.ViserServer) -> None:
    arrows = Arrows(server, "/test_arrows", 1, COMMANDED, 0.01)
    arrows.enabled = False
    arrows.draw(np.zeros((1, 3)), np.ones((1, 3)), np.array([True]))
    assert not arrows.visible
