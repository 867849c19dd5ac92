"""Wrench projection: which contact forces explain a generalized residual, paper eqs. (9)-(11).

The stacked wrench is x = [lambda_c (12), f_e (3), m_e (3)] in the heading frame: ground on wheels FL, FR, RL, RR, then the
environment on the end effector. The residual model is r = B x + eps with B = [J_c^T, J_e^T], eq. (9).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgelsy, dposv

from control.joints import ARM_SLICE, LEG_SLICE, LEGS, WHEEL_SLICE
from control.robot_model import WRENCH_SIZE, RobotModel

SUPPORT_ROWS = slice(0, 3 * len(LEGS))
FORCE_ROWS = slice(3 * len(LEGS), 3 * len(LEGS) + 3)
MOMENT_ROWS = slice(3 * len(LEGS) + 3, WRENCH_SIZE)

_RANK_TOLERANCE = 1e-10


@dataclass(frozen=True, slots=True)
class ProjectionWeights:
    """W_q and R of eq. (10): how far each generalized row is trusted, and what each wrench part costs.

    Arm rows dominate because only the end effector loads them; base and leg rows mix it with the wheel forces. The moment
    costs most: the tool touches with a ball, which passes forces but hardly moments.

    Attributes:
        base_row, leg_row, wheel_row, arm_row: entries of W_q, 1/N on the base's force rows and 1/(N m) elsewhere.
        support_cost, force_cost: entries of R on forces, 1/N^2.
        moment_cost: entry of R on the end-effector moment, 1/(N m)^2.
    """

    base_row: float = 0.3
    leg_row: float = 0.1
    wheel_row: float = 0.1
    arm_row: float = 1.0
    support_cost: float = 1e-4
    force_cost: float = 1e-4
    moment_cost: float = 1e2

    def rows(self, model: RobotModel) -> np.ndarray:
        """(28,) diagonal of W_q in generalized order."""
        rows = np.empty(len(model.velocity))
        rows[:6] = self.base_row
        rows[model.joint_rows[LEG_SLICE]] = self.leg_row
        rows[model.joint_rows[WHEEL_SLICE]] = self.wheel_row
        rows[model.joint_rows[ARM_SLICE]] = self.arm_row
        return rows

    def costs(self) -> np.ndarray:
        """(18,) diagonal of R."""
        costs = np.empty(WRENCH_SIZE)
        costs[SUPPORT_ROWS] = self.support_cost
        costs[FORCE_ROWS] = self.force_cost
        costs[MOMENT_ROWS] = self.moment_cost
        return costs


def wrench_jacobian_in_heading(model: RobotModel, rotation_heading_to_world: np.ndarray) -> np.ndarray:
    """B^T (18, 28) whose wrench is in the heading frame."""
    stacked = model.wrench_jacobian.reshape(WRENCH_SIZE // 3, 3, -1)
    return np.matmul(rotation_heading_to_world.T, stacked).reshape(WRENCH_SIZE, -1)


def pseudo_inverse_wrench(jacobian: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Minimum-norm least-squares wrench x = B^# r (the paper's GMO-PI).

    Args:
        jacobian: (18, 28) B^T.
        residual: (28,) r.

    Returns:
        (18,) x.
    """
    right_side = residual[:, None]
    pivots = np.zeros(WRENCH_SIZE, dtype=np.int32)
    _, x, _, _, _ = dgelsy(jacobian.T, right_side, pivots, _RANK_TOLERANCE, lwork=600)
    return x[:WRENCH_SIZE, 0]


@dataclass(frozen=True, slots=True)
class WrenchProblem:
    """One instance of eq. (10) as a quadratic form: minimise 1/2 x^T H x - b^T x.

    Attributes:
        weighted_jacobian: (18, 28) B^T W_q.
        hessian: (18, 18) H = B^T W_q^2 B + R, positive definite.
        right_side: (18,) b = B^T W_q^2 r.
    """

    weighted_jacobian: np.ndarray
    hessian: np.ndarray
    right_side: np.ndarray


def build_wrench_problem(jacobian: np.ndarray, residual: np.ndarray, rows: np.ndarray, costs: np.ndarray) -> WrenchProblem:
    """Assemble eq. (10) without its constraints.

    Args:
        jacobian: (18, 28) B^T.
        residual: (28,) r.
        rows: (28,) diagonal of W_q.
        costs: (18,) diagonal of R, positive.
    """
    weighted = jacobian * rows
    hessian = weighted @ weighted.T
    hessian.flat[:: WRENCH_SIZE + 1] += costs
    return WrenchProblem(weighted, hessian, weighted @ (rows * residual))


def solve_positive_definite(hessian: np.ndarray, right_side: np.ndarray) -> np.ndarray:
    """H^-1 b by Cholesky, without the overhead of numpy's checks; `right_side` is (18,) or (18, k).

    Raises:
        numpy.linalg.LinAlgError: H is not positive definite.
    """
    _, x, info = dposv(hessian, right_side)
    if info != 0:
        raise np.linalg.LinAlgError(f"H is not positive definite (dposv info {info}); every cost in R must be positive")
    return x


def project_on_friction_cone(forces: np.ndarray, friction: float) -> np.ndarray:
    """Nearest forces a wheel can feel: Euclidean projection on the cone |f_xy| <= mu f_z.

    Args:
        forces: (n, 3) N, z along the ground's normal.
        friction: mu > 0.

    Returns:
        (n, 3) N.
    """
    # Plain floats: for four wheels they beat arrays.
    projected = []
    for x, y, z in forces.tolist():
        tangential = math.hypot(x, y)
        if tangential <= friction * z:
            projected.append((x, y, z))
        elif friction * tangential <= -z:
            projected.append((0.0, 0.0, 0.0))
        else:
            normal = (friction * tangential + z) / (1.0 + friction * friction)
            shrink = friction * normal / tangential
            projected.append((x * shrink, y * shrink, normal))
    return np.array(projected)
