"""Where a wheel touches level ground."""

import math

import numpy as np

from control.joints import WHEEL_HALF_WIDTH_M, WHEEL_RADIUS_M
from control.kernels.compiled import kernel
from control.kernels.small_algebra import Triple


@kernel("UniTuple(f8, 3)(vector)")
def lowest_point_from_center(axis: np.ndarray) -> Triple:
    """Support point, m, of a wheel's ellipsoid in direction d = -z, from its centre, whatever its camber.

    D^2 d / sqrt(d^T D^2 d) with D^2 = r^2 1 + (b^2 - r^2) a a^T, radius r and half width b.

    Args:
        axis: (3,) a, unit vector of the wheel's axle, in axes with z up.
    """
    flattening = WHEEL_HALF_WIDTH_M**2 - WHEEL_RADIUS_M**2
    scale = math.sqrt(WHEEL_RADIUS_M**2 + flattening * axis[2] ** 2)
    along = -flattening * axis[2] / scale
    return along * axis[0], along * axis[1], along * axis[2] - WHEEL_RADIUS_M**2 / scale


@kernel("f8[:,::1](matrix, matrix)")
def lowest_points(centers: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Lowest points (n, 3), m, of wheels with these centres (n, 3) and axles (n, 3)."""
    points = np.empty((len(centers), 3))
    for wheel in range(len(centers)):
        x, y, z = lowest_point_from_center(axes[wheel])
        points[wheel, 0], points[wheel, 1], points[wheel, 2] = (
            centers[wheel, 0] + x,
            centers[wheel, 1] + y,
            centers[wheel, 2] + z,
        )
    return points
