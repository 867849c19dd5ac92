"""The mask law: position axes track, force axes regulate once what is asked for has met something."""

import numpy as np
import pytest

from control.command.axis_mask import force_share

SHARE, NOISE_N = 0.3, 1.0


def share(mask: float, force_n: float, force_estimated_n: float) -> float:
    return force_share(mask, force_n, force_estimated_n, SHARE, NOISE_N)


@pytest.mark.parametrize("estimated_n", [-30.0, 0.0, 30.0])
def test_a_position_axis_is_never_under_force_control(estimated_n):
    assert share(0.0, 20.0, estimated_n) == 0.0


def test_a_force_axis_turns_to_force_control_as_contact_builds_up_in_either_direction():
    needed = SHARE * 20.0 - NOISE_N
    for sign in (1.0, -1.0):
        shares = [share(1.0, sign * 20.0, sign * part * needed) for part in (-1.0, 0.0, 0.25, 1.0, 3.0)]
        assert np.allclose(shares, [0.0, 0.0, 0.25, 1.0, 1.0])


def test_a_force_within_the_noise_needs_no_contact():
    assert share(1.0, NOISE_N / SHARE, 0.0) == 1.0
    assert share(1.0, 1.01 * NOISE_N / SHARE, 0.0) == 0.0


def test_an_axis_that_is_asked_for_no_force_yields_to_what_is_more_than_noise():
    assert share(1.0, 0.0, 0.0) == share(1.0, 0.0, NOISE_N) == share(1.0, 0.0, -NOISE_N) == 0.0
    assert share(1.0, 0.0, 1.5 * NOISE_N) == share(1.0, 0.0, -1.5 * NOISE_N) == 0.5
    assert share(1.0, 0.0, 2.0 * NOISE_N) == share(1.0, 0.0, -40.0) == 1.0
    assert share(0.0, 0.0, 40.0) == 0.0


def test_contact_can_be_taken_for_granted():
    assert force_share(1.0, 20.0, 0.0, 0.0, NOISE_N) == 1.0
