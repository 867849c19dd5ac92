"""The law of scripted pulses, all of them at once: the console allows so many that a tick has no time for each in Python."""

import math

import numpy as np

from control.kernels.compiled import kernel

ROW = 14
"""Numbers of one pulse: start, duration, ramp, s; frame, index into FRAMES; body; force, N, torque, N m, and point, m, of 3."""

WORLD, HEADING, BODY = 0, 1, 2


@kernel("f8(f8, f8, f8)")
def profile_integral(age_s: float, duration_s: float, ramp_s: float) -> float:
    """Integral, s, up to an age, of a profile that rises from 0 to 1 over `ramp_s`, holds, and falls over `ramp_s`."""
    age = min(max(age_s, 0.0), duration_s)
    rising = min(age, ramp_s)
    falling = max(age - (duration_s - ramp_s), 0.0)
    area = age - rising
    if ramp_s > 0.0:
        area += 0.5 * (rising * rising - falling * falling) / ramp_s
    return area


@kernel("void(f8[:,::1], f8, f8, i8, matrix, matrix, matrix, f8[:,::1])")
def add_pulses(
    pulses: np.ndarray,
    time_s: float,
    period_s: float,
    base: int,
    rotation: np.ndarray,
    position: np.ndarray,
    center: np.ndarray,
    applied: np.ndarray,
) -> None:
    """Add the mean wrench of each pulse over the tick that starts now to its body, about that body's centre of mass.

    Args:
        pulses: (n, ROW).
        time_s, period_s: start and length of the tick.
        base: body whose yaw is the heading.
        rotation: (bodies, 9) body to world, row by row.
        position: (bodies, 3) m, of the bodies' origins in world.
        center: (bodies, 3) m, of their centres of mass.
        applied: (bodies, 6) N and N m in world, added to.
    """
    norm = math.hypot(rotation[base, 0], rotation[base, 3])
    cos, sin = rotation[base, 0] / norm, rotation[base, 3] / norm
    force, torque = np.empty(3), np.empty(3)
    for pulse in pulses:
        age, duration, ramp, frame, body = time_s - pulse[0], pulse[1], pulse[2], int(pulse[3]), int(pulse[4])
        level = (profile_integral(age + period_s, duration, ramp) - profile_integral(age, duration, ramp)) / period_s
        for i in range(3):
            force[i], torque[i] = level * pulse[5 + i], level * pulse[8 + i]
        turn = rotation[body]
        if frame == HEADING:
            force[0], force[1] = cos * force[0] - sin * force[1], sin * force[0] + cos * force[1]
            torque[0], torque[1] = cos * torque[0] - sin * torque[1], sin * torque[0] + cos * torque[1]
        elif frame == BODY:
            fx, fy, fz = force
            mx, my, mz = torque
            for i in range(3):
                force[i] = turn[3 * i] * fx + turn[3 * i + 1] * fy + turn[3 * i + 2] * fz
                torque[i] = turn[3 * i] * mx + turn[3 * i + 1] * my + turn[3 * i + 2] * mz
        px, py, pz = pulse[11], pulse[12], pulse[13]
        x = position[body, 0] + turn[0] * px + turn[1] * py + turn[2] * pz - center[body, 0]
        y = position[body, 1] + turn[3] * px + turn[4] * py + turn[5] * pz - center[body, 1]
        z = position[body, 2] + turn[6] * px + turn[7] * py + turn[8] * pz - center[body, 2]
        for i in range(3):
            applied[body, i] += force[i]
            applied[body, 3 + i] += torque[i]
        applied[body, 3] += y * force[2] - z * force[1]
        applied[body, 4] += z * force[0] - x * force[2]
        applied[body, 5] += x * force[1] - y * force[0]
