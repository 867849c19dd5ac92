"""Zero-force guidance: the map from force to base motion and the soft centring of the hand."""

from dataclasses import replace

import numpy as np
import pytest

from control.command.guidance import Guidance, GuidanceConfig, centring_force, driving_force, guidance_record
from control.command.limits import DEFAULT_COMMAND, HandState
from control.frames import rotation_from_quaternion
from control.timing import CONTROL_PERIOD_S

CONFIG = GuidanceConfig()
GUIDED = replace(DEFAULT_COMMAND, guidance=True)


def hand(force=(0.0, 0.0, 0.0), displacement=(0.0, 0.0, 0.0)):
    rotation = rotation_from_quaternion(DEFAULT_COMMAND.orientation_wxyz)
    return HandState(DEFAULT_COMMAND.position_m + displacement, rotation, np.array(force, float))


def centring(*displacement):
    force = np.empty(3)
    centring_force(guidance_record(CONFIG)[0], np.array(displacement), force)
    return force


def settled(force, seconds=1.0):
    return repeat(Guidance(CONFIG), hand(force), seconds)


def repeat(guidance, state, seconds):
    for _ in range(round(seconds / CONTROL_PERIOD_S) - 1):
        guidance.step(GUIDED, state, CONTROL_PERIOD_S)
    return guidance.step(GUIDED, state, CONTROL_PERIOD_S)


def test_a_command_without_guidance_passes_unchanged():
    assert Guidance(CONFIG).step(DEFAULT_COMMAND, hand((20.0, 0.0, 0.0)), CONTROL_PERIOD_S) is DEFAULT_COMMAND


def test_guidance_overrides_mask_and_force_and_keeps_the_orientation():
    asked = replace(GUIDED, force_n=np.array([9.0, 9.0, 9.0]), base_velocity=np.array([0.5, 0.0, 0.5]))
    command = Guidance(CONFIG).step(asked, hand(), CONTROL_PERIOD_S)
    assert np.array_equal(command.mask, np.ones(3))
    assert np.array_equal(command.force_n, np.zeros(3))
    assert np.array_equal(command.base_velocity, np.zeros(3))
    assert np.array_equal(command.orientation_wxyz, asked.orientation_wxyz)


@pytest.mark.parametrize("angle", np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False))
def test_the_base_rests_within_the_dead_band_in_every_direction(angle):
    force = 0.99 * CONFIG.dead_band_n * np.array([np.cos(angle), np.sin(angle), 0.0])
    assert np.array_equal(settled(force).base_velocity, np.zeros(3))


@pytest.mark.parametrize(
    ("force", "sign_x", "sign_yaw"), [((10, 0, 0), 1, 0), ((-10, 0, 0), -1, 0), ((0, 10, 0), 0, 1), ((0, -10, 0), 0, -1)]
)
def test_a_pull_ahead_rolls_and_a_pull_aside_turns_towards_it(force, sign_x, sign_yaw):
    velocity = settled(force).base_velocity
    assert np.sign(velocity[0]) == sign_x
    assert np.sign(velocity[2]) == sign_yaw
    assert velocity[1] == 0.0


def test_a_gently_led_base_follows_the_hand_before_the_force_is_felt_and_a_bias_alone_does_not_move_it():
    led = Guidance(CONFIG)
    led.step(GUIDED, hand(), CONTROL_PERIOD_S)
    assert repeat(led, hand((1.0, 0.0, 0.0), displacement=(0.12, 0.0, 0.0)), 0.2).base_velocity[0] > 0.0
    assert settled((1.0, 0.0, 0.0)).base_velocity[0] == 0.0


def test_a_firm_pull_drives_the_base_by_the_estimate_alone():
    smoothed, centring, drive = np.array([0.0, -2.0 * CONFIG.gentle_n, 0.0]), np.array([-30.0, 4.0, 2.0]), np.empty(3)
    driving_force(guidance_record(CONFIG)[0], smoothed, centring, drive)
    assert np.array_equal(drive, smoothed)
    driving_force(guidance_record(CONFIG)[0], 0.4 * smoothed, centring, drive)
    assert np.allclose(drive, 0.5 * (0.4 * smoothed + centring))


def test_a_vertical_force_does_not_move_the_base():
    assert np.array_equal(settled((0.0, 0.0, 30.0)).base_velocity, np.zeros(3))


def test_the_base_velocity_saturates():
    velocity = settled((300.0, -300.0, 0.0)).base_velocity
    assert velocity[0] == CONFIG.forward_limit_mps
    assert velocity[2] == -CONFIG.yaw_limit_rps


def test_a_step_of_the_force_is_smoothed_and_letting_go_stops_within_half_a_second():
    guidance = Guidance(CONFIG)
    first = guidance.step(GUIDED, hand((15.0, 0.0, 0.0)), CONTROL_PERIOD_S).base_velocity[0]
    pulled = repeat(guidance, hand((15.0, 0.0, 0.0)), 1.0).base_velocity[0]
    assert first < 0.2 * pulled
    assert repeat(guidance, hand(), 0.5).base_velocity[0] == 0.0


def test_centring_costs_less_than_five_newton_at_ten_centimetres_and_holds_fifteen_within_twenty():
    assert np.linalg.norm(centring(0.06, -0.08, 0.0)) < 5.0
    assert np.linalg.norm(centring(0.0, 0.2, 0.0)) > 15.0


def test_centring_force_is_continuous_and_along_the_displacement():
    distances = np.linspace(0.0, 0.3, 301)
    forces = np.array([centring(0.0, distance, 0.0) for distance in distances])
    assert np.array_equal(forces[:, [0, 2]], np.zeros((301, 2)))
    steps = np.diff(forces[:, 1])
    assert np.all(steps > 0.0)
    assert steps.max() < 1.01 * (CONFIG.stretch_stiffness + CONFIG.end_stiffness) * 1e-3
    assert centring(0.0, 0.3, 0.0)[1] > 40.0, "a firm pull stretches the arm by less than 30 cm"


def test_entering_far_from_the_comfortable_place_starts_without_force_and_glides_there():
    guidance = Guidance(CONFIG)
    away = hand(displacement=(0.0, 0.2, 0.0))
    first = guidance.step(GUIDED, away, CONTROL_PERIOD_S).force_n
    assert np.linalg.norm(first) < 0.5
    last = repeat(guidance, away, 2.0).force_n
    assert np.allclose(last, centring(0.0, 0.2, 0.0))


def test_leaving_guidance_forgets_the_force():
    guidance = Guidance(CONFIG)
    repeat(guidance, hand((15.0, 0.0, 0.0)), 1.0)
    guidance.step(DEFAULT_COMMAND, hand(), CONTROL_PERIOD_S)
    assert np.array_equal(guidance.step(GUIDED, hand(), CONTROL_PERIOD_S).base_velocity, np.zeros(3))
