"""A following camera goes where the robot goes, and yields to its operator."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from web import camera as camera_module
from web.camera import CENTER, FOV_RAD, HALF_WIDTH, Follower, fit_to_canvas, fov_rad


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(camera_module.time, "monotonic", lambda: now[0])
    return now


@pytest.fixture
def client() -> Any:
    return SimpleNamespace(camera=SimpleNamespace(position=np.array([1.6, -1.4, 0.9]), look_at=np.array([0.0, 0.0, 0.4])))


def test_the_camera_keeps_its_place_relative_to_the_robot(clock: list[float], client: Any) -> None:
    arm = client.camera.position - client.camera.look_at
    follower = Follower(cast(Any, client))
    for step in range(1, 11):
        follower.update(np.array([0.1 * step, -0.05 * step, 0.36 + 0.01 * step]))
        np.testing.assert_allclose(client.camera.look_at, [0.1 * step, -0.05 * step, 0.0] + CENTER)
        np.testing.assert_allclose(client.camera.position - client.camera.look_at, arm)


def test_reports_that_lag_behind_do_not_disturb(clock: list[float], client: Any) -> None:
    follower = Follower(cast(Any, client))
    late = client.camera.position.copy(), client.camera.look_at.copy()
    for step in range(1, 11):
        follower.update(np.array([0.1 * step, 0.0, 0.36]))
        np.testing.assert_allclose(client.camera.look_at, [0.1 * step, 0.0, 0.0] + CENTER)
        client.camera.position, client.camera.look_at = late
        late = np.array([0.1 * step, 0.0, 0.0]) + late[0], np.array([0.1 * step, 0.0, 0.0]) + late[1]


def test_a_standing_robot_sends_nothing(clock: list[float], client: Any) -> None:
    follower = Follower(cast(Any, client))
    follower.update(np.zeros(3))
    position = client.camera.position
    follower.update(np.array([0.001, 0.0, 0.0]))
    assert client.camera.position is position


def test_following_pauses_while_the_operator_turns_the_camera_and_then_keeps_the_new_view(
    clock: list[float], client: Any
) -> None:
    follower = Follower(cast(Any, client))
    follower.update(np.zeros(3))
    turned = client.camera.look_at + [0.0, -2.0, 0.5]
    client.camera.position = turned
    follower.update(np.array([0.2, 0.0, 0.0]))
    np.testing.assert_allclose(client.camera.position, turned)
    clock[0] += 1.0
    follower.update(np.array([0.3, 0.0, 0.0]))
    np.testing.assert_allclose(client.camera.position, CENTER + [0.3, -2.0, 0.5])


@pytest.mark.parametrize("aspect", [0.2, 0.46, 0.65, 0.9, 1.0, 1.6, 4.0])
def test_a_narrow_canvas_shows_as_much_in_width_and_a_wide_one_as_much_in_height(aspect: float) -> None:
    half_height = np.tan(fov_rad(aspect) / 2.0)
    assert half_height * aspect >= HALF_WIDTH - 1e-9
    assert fov_rad(aspect) >= FOV_RAD - 1e-9
    assert fov_rad(aspect) == pytest.approx(FOV_RAD) or half_height * aspect == pytest.approx(HALF_WIDTH)


def test_a_camera_follows_its_canvas_and_keeps_its_view_while_there_is_none() -> None:
    camera: Any = SimpleNamespace(image_width=390, image_height=600, aspect=0.65, fov=FOV_RAD)
    fit_to_canvas(camera)
    assert camera.fov == fov_rad(0.65)
    camera.image_height = 0
    fit_to_canvas(camera)
    assert camera.fov == fov_rad(0.65)
