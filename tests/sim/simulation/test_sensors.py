"""Sensor errors: the stated statistics, quantisation, delay, and repeatability."""

from dataclasses import replace

import numpy as np
import pytest

from control.frames import quaternion_multiply
from control.joints import JOINT_COUNT
from control.types import SensorFrame
from sim.backends.simulation.sensors import SensorConfig, SensorModel


def frame(time_s: float = 0.0) -> SensorFrame:
    return SensorFrame(
        time_s=time_s,
        orientation_wxyz=np.array([np.cos(0.3), 0.0, np.sin(0.3), 0.0]),
        angular_velocity=np.array([0.1, -0.2, 0.3]),
        linear_acceleration=np.array([0.5, 0.0, 9.7]),
        joint_position=np.linspace(-1.0, 1.0, JOINT_COUNT),
        joint_velocity=np.linspace(-3.0, 3.0, JOINT_COUNT),
        joint_torque=np.linspace(-20.0, 20.0, JOINT_COUNT),
    )


def measure(model: SensorModel, ideal: SensorFrame) -> SensorFrame:
    parts = (ideal.joint_position, ideal.joint_velocity, ideal.joint_torque, ideal.angular_velocity)
    sample = np.concatenate([*parts, ideal.linear_acceleration, ideal.orientation_wxyz])
    return model.measure(ideal.time_s, sample)


def attitude_error(measured: np.ndarray, true: np.ndarray) -> np.ndarray:
    conjugate = true * [1.0, -1.0, -1.0, -1.0]
    return 2.0 * quaternion_multiply(conjugate, measured)[1:]


def test_ideal_sensors_return_the_sample_unchanged():
    ideal = frame(1.5)
    measured = measure(SensorModel(SensorConfig.ideal(), seed=3), ideal)
    for name in SensorFrame.__slots__:
        np.testing.assert_allclose(getattr(measured, name), getattr(ideal, name), atol=1e-15, err_msg=name)


@pytest.mark.parametrize(
    ("channel", "noise", "offset"),
    [
        ("joint_position", "joint_position_noise_std", "joint_position_offset_std"),
        ("joint_velocity", "joint_velocity_noise_std", None),
        ("joint_torque", "joint_torque_noise_std", None),
        ("angular_velocity", "gyro_noise_std", "gyro_bias_std"),
        ("linear_acceleration", "accelerometer_noise_std", "accelerometer_bias_std"),
    ],
)
def test_noise_is_white_around_a_constant_offset(channel, noise, offset):
    """Within one seed: white noise. Over seeds: the offset's deviation."""
    config = replace(SensorConfig(), joint_position_quantum=0.0, joint_torque_quantum=0.0, joint_torque_scale_std=0.0)
    ideal = frame()
    means = []
    for seed in range(40):
        model = SensorModel(config, seed)
        errors = np.array([getattr(measure(model, ideal), channel) - getattr(ideal, channel) for _ in range(400)])
        means.append(errors.mean(0))
        if seed == 0:
            white = errors - errors.mean(0)
            assert white.std() == pytest.approx(getattr(config, noise), rel=0.1)
            assert abs((white[1:] * white[:-1]).mean()) < 0.1 * white.var()
    spread = np.array(means).std()
    expected = getattr(config, offset) if offset else 0.0
    assert spread == pytest.approx(np.hypot(expected, getattr(config, noise) / np.sqrt(400)), rel=0.3)


def test_torque_scale_is_a_constant_gain_per_joint():
    config = replace(SensorConfig.ideal(), joint_torque_scale_std=0.01)
    model = SensorModel(config, seed=0)
    ideal = frame()
    gain = measure(model, ideal).joint_torque / ideal.joint_torque
    doubled = measure(model, replace(ideal, joint_torque=2 * ideal.joint_torque)).joint_torque / (2 * ideal.joint_torque)
    np.testing.assert_allclose(gain, doubled)
    assert 0.005 < np.std(gain) < 0.02


def test_positions_and_torques_are_whole_quanta():
    config = SensorConfig()
    measured = measure(SensorModel(config, seed=1), frame())
    for values, quantum in (
        (measured.joint_position, config.joint_position_quantum),
        (measured.joint_torque, config.joint_torque_quantum),
    ):
        np.testing.assert_allclose(values / quantum, np.rint(values / quantum), atol=1e-6)


def test_quantisation_alone_errs_by_half_a_quantum_at_most():
    config = replace(SensorConfig.ideal(), joint_position_quantum=0.01)
    errors = measure(SensorModel(config, seed=0), frame()).joint_position - frame().joint_position
    assert 0.0 < np.abs(errors).max() <= 0.005 + 1e-12


@pytest.mark.parametrize("delay", [0, 1, 4])
def test_delay_is_whole_ticks_and_repeats_the_oldest_frame_at_start(delay):
    model = SensorModel(replace(SensorConfig.ideal(), delay_ticks=delay), seed=0)
    delivered = [measure(model, frame(float(tick))).time_s for tick in range(10)]
    assert delivered == [max(0.0, tick - delay) for tick in range(10)]


def test_attitude_error_is_slow_and_of_the_stated_size():
    config = SensorConfig()
    ideal = frame()
    sizes = []
    for seed in range(30):
        model = SensorModel(config, seed)
        errors = np.array([attitude_error(measure(model, ideal).orientation_wxyz, ideal.orientation_wxyz) for _ in range(300)])
        sizes.append(errors[-1])
        # One tick changes it by far less than its size: no white part.
        assert np.abs(np.diff(errors, axis=0)).max() < 0.15 * config.attitude_drift_std
    assert np.std(sizes) == pytest.approx(np.hypot(config.attitude_bias_std, config.attitude_drift_std), rel=0.25)


def test_attitude_drift_keeps_its_stationary_deviation_and_forgets():
    config = replace(SensorConfig.ideal(), attitude_drift_std=3e-3, attitude_drift_time_s=0.1)
    model = SensorModel(config, seed=0)
    ideal = frame()
    errors = np.array([attitude_error(measure(model, ideal).orientation_wxyz, ideal.orientation_wxyz) for _ in range(20000)])
    assert errors.std() == pytest.approx(3e-3, rel=0.15)
    lag = 50  # 0.1 s: one time constant
    correlation = (errors[lag:] * errors[:-lag]).mean() / errors.var()
    assert correlation == pytest.approx(np.exp(-1.0), abs=0.12)


def test_the_same_seed_repeats():
    ideal = frame()
    first, second = SensorModel(SensorConfig(), seed=4), SensorModel(SensorConfig(), seed=4)
    for _ in range(100):
        np.testing.assert_array_equal(measure(first, ideal).joint_position, measure(second, ideal).joint_position)


@pytest.mark.parametrize("value", [-1.0, float("nan")])
def test_a_wrong_figure_is_refused_by_name(value):
    with pytest.raises(ValueError, match="gyro_noise_std"):
        SensorConfig(gyro_noise_std=value)


@pytest.mark.parametrize("delay", [0, 5])
def test_torque_delay_ages_the_torques_alone(delay):
    model = SensorModel(replace(SensorConfig.ideal(), torque_delay_ticks=delay), seed=0)
    frames = [measure(model, replace(frame(float(tick)), joint_torque=np.full(JOINT_COUNT, float(tick)))) for tick in range(10)]
    assert [frame.joint_torque[3] for frame in frames] == [max(0.0, tick - delay) for tick in range(10)]
    assert [frame.time_s for frame in frames] == list(range(10))
