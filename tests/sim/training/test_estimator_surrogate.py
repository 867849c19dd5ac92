"""The fit recovers what made the recordings; the surrogate reproduces it; damaged files are named."""

from pathlib import Path

import numpy as np
import pytest

from sim.training.fit_surrogate import EstimatorRecording, filtered, fit
from sim.training.surrogate import EstimatorSurrogate, SurrogateError, SurrogateParameters, fitted_surrogate

MADE_WITH = SurrogateParameters(
    natural_frequency_rps=10.0,
    damping_ratio=0.67,
    gain_std=0.02,
    bias_std_n=(0.2, 0.2, 0.2),
    mass_bias_n=(0.0, 0.0, 8.0),
    motion_n=((1.5, 0.0, 0.4, 0.0), (0.0, -2.0, 0.0, 0.3), (0.0, 0.0, 0.0, 0.0)),
    noise_std_n=(0.1, 0.2, 0.3),
    noise_memory=0.8,
)


def recordings() -> list[EstimatorRecording]:
    """Runs whose estimates are the model's, with its bias and noise."""
    random, result = np.random.default_rng(0), []
    for mass_error in (-0.15, -0.15, 0.0, 0.0, 0.15, 0.15):
        steps = np.repeat(random.uniform(-20.0, 20.0, (20, 3)), 50, axis=0)
        motion = np.repeat(random.uniform(-0.5, 0.5, (40, 4)), 25, axis=0)
        noise = np.zeros((1000, 3))
        fresh = random.standard_normal((1000, 3)) * MADE_WITH.noise_std_n * np.sqrt(1 - MADE_WITH.noise_memory**2)
        for t in range(1, 1000):
            noise[t] = MADE_WITH.noise_memory * noise[t - 1] + fresh[t]
        empty = EstimatorRecording(steps, steps, motion, mass_error)
        estimate = filtered(empty, MADE_WITH.natural_frequency_rps, MADE_WITH.damping_ratio) + noise
        estimate += motion @ np.array(MADE_WITH.motion_n).T + mass_error * np.array(MADE_WITH.mass_bias_n)
        estimate += 0.2 * random.standard_normal(3)
        result.append(EstimatorRecording(steps, estimate, motion, mass_error))
    return result


@pytest.mark.slow
def test_fit_recovers_the_model():
    found = fit(recordings())
    assert found.natural_frequency_rps == pytest.approx(10.0, rel=0.15)
    assert np.allclose(found.motion_n, MADE_WITH.motion_n, atol=0.15)
    assert found.mass_bias_n[2] == pytest.approx(8.0, abs=2.0)
    assert np.allclose(found.noise_std_n, MADE_WITH.noise_std_n, rtol=0.4)
    assert found.noise_memory == pytest.approx(0.8, abs=0.1)


def test_fit_needs_recordings():
    with pytest.raises(ValueError, match="no recordings"):
        fit([])


def test_surrogate_settles_on_the_force_plus_its_errors():
    random = np.random.default_rng(1)
    quiet = SurrogateParameters(10.0, 0.67, 0.0, (0.0,) * 3, (0.0, 0.0, 8.0), ((0.0,) * 4,) * 3, (0.0,) * 3, 0.8)
    surrogate = EstimatorSurrogate(quiet, np.array([1.0, 1.1]), random)
    force = np.tile([5.0, -3.0, 20.0], (2, 1))
    for _ in range(150):
        surrogate.step(force, np.zeros((2, 2)))
    assert np.allclose(surrogate.force, [[5.0, -3.0, 20.0], [5.0, -3.0, 20.8]], atol=1e-3)


def test_reset_robots_feel_nothing():
    surrogate = EstimatorSurrogate(MADE_WITH, np.ones(2), np.random.default_rng(1))
    surrogate.step(np.full((2, 3), 10.0), np.zeros((2, 2)))
    surrogate.reset(np.array([0]))
    assert not surrogate.force[0].any()
    assert surrogate.force[1].any()


@pytest.mark.parametrize("content", [None, "{", '{"parameters": {"damping_ratio": 1}}'])
def test_unusable_files_name_the_cure(tmp_path: Path, content: str | None):
    path = tmp_path / "surrogate.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(SurrogateError, match="fit_surrogate"):
        fitted_surrogate(path)


def test_the_shipped_fit_can_be_read():
    assert fitted_surrogate().natural_frequency_rps > 0.0
