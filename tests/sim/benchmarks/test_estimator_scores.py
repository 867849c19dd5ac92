"""What the estimator benchmark measures: RMSE by hand, lag against its closed form, calibration of Gaussian errors."""

import numpy as np
import pytest

from control.estimation.momentum_observer import FAST_GAINS, PAPER_GAINS, SLOPE_GAINS, ObserverGains
from control.timing import TICK_S
from sim.benchmarks.estimator_scores import Scores, coverage, lag_only_error, mean_and_deviation


def test_rmse_of_a_series_by_hand() -> None:
    error = np.array([[3.0, 4.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 12.0], [0.0, -4.0, 0.0]])
    score = Scores(error, np.full((4, 3), np.nan))
    np.testing.assert_allclose(score.rmse_axes_n, [1.5, np.sqrt(8.0), 6.0])
    # Lengths 5, 0, 12, 4: the vector RMSE is that of the lengths, and of the three axes together.
    assert score.rmse_vector_n == pytest.approx(np.sqrt((25 + 0 + 144 + 16) / 4))
    assert score.rmse_vector_n == pytest.approx(np.linalg.norm(score.rmse_axes_n))


def test_spread_is_the_sample_standard_deviation() -> None:
    assert mean_and_deviation([1.0, 2.0, 6.0]) == pytest.approx((3.0, np.sqrt(7.0)))
    assert mean_and_deviation([2.0]) == (2.0, None)


@pytest.mark.parametrize("gains", [PAPER_GAINS, FAST_GAINS, SLOPE_GAINS])
def test_lag_on_a_ramp_is_k1_over_k2_times_its_slope_unless_the_slope_is_followed(gains: ObserverGains) -> None:
    slope = np.array([5.0, -2.0, 1.0])
    time = TICK_S * np.arange(4000)
    error = lag_only_error(time[:, None] * slope, gains, TICK_S)
    lag_s = 0.0 if gains.k3 else gains.k1 / gains.k2
    np.testing.assert_allclose(error[-1], -lag_s * slope, rtol=0.02, atol=2 * TICK_S * np.abs(slope).max())


def test_lag_on_a_sine_is_that_of_the_transfer_function() -> None:
    frequency = 2.0 * np.pi * 0.2
    time = TICK_S * np.arange(20_000)
    force = np.outer(np.sin(frequency * time), [1.0, 0.0, 2.0])
    s = 1j * frequency
    response = PAPER_GAINS.k2 / (s * s + PAPER_GAINS.k1 * s + PAPER_GAINS.k2)
    error = lag_only_error(force, PAPER_GAINS, TICK_S)[10_000:]
    expected = abs(response - 1.0) / np.sqrt(2.0)
    np.testing.assert_allclose(np.sqrt((error**2).mean(axis=0)), expected * np.array([1.0, 0.0, 2.0]), rtol=0.01, atol=1e-9)


def test_gaussian_errors_of_the_stated_size_are_covered_as_they_should() -> None:
    random = np.random.default_rng(0)
    sigma = random.uniform(0.2, 2.0, (20_000, 3))
    honest = Scores(sigma * random.standard_normal(sigma.shape), sigma)
    assert coverage([honest], 1.0) == pytest.approx(0.683, abs=0.01)
    assert coverage([honest], 2.0) == pytest.approx(0.954, abs=0.005)
    proud = Scores(2.0 * honest.error, sigma)
    assert coverage([proud], 2.0) == pytest.approx(0.683, abs=0.01)
    assert coverage([honest, proud], 2.0) == pytest.approx(0.5 * (0.683 + 0.954), abs=0.01)


def test_coverage_counts_known_sigmas_alone() -> None:
    sigma = np.array([[1.0, 1.0, 1.0], [np.nan, np.nan, np.nan]])
    assert coverage([Scores(np.array([[1.0, 3.0, -1.9], [0.0, 0.0, 0.0]]), sigma)], 2.0) == pytest.approx(2 / 3)
    assert coverage([Scores(np.zeros((2, 3)), np.full((2, 3), np.nan))], 2.0) is None
