"""Wrench projection: which contact forces explain a generalized residual, paper eqs. (9)-(11).

The stacked wrench is x = [lambda_c (12), f_e (3), m_e (3)] in the heading frame: ground on wheels FL, FR, RL, RR, then the
environment on the end effector. The residual model is r = B x + eps with B = [J_c^T, J_e^T], eq. (9).
"""

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgelsy

from control.joints import ARM_SLICE, JOINT_COUNT, LEG_SLICE, LEGS, WHEEL_SLICE
from control.kernels.compiled import kernel
from control.kernels.small_algebra import rotate_back, solve_positive
from control.robot_model import WRENCH_SIZE, RobotModel
from control.values import value

SUPPORT_ROWS = slice(0, 3 * len(LEGS))
FORCE_ROWS = slice(3 * len(LEGS), 3 * len(LEGS) + 3)
MOMENT_ROWS = slice(3 * len(LEGS) + 3, WRENCH_SIZE)

_RANK_TOLERANCE = 1e-10
_FULL_RANK_PIVOT = 1e-3
"""Smallest pivot of the Cholesky factor of B^T B, over the largest, with which the normal equations are exact enough."""

_WHOLE = np.ones(6 + JOINT_COUNT)
_FREE = np.zeros(WRENCH_SIZE)


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


@kernel("void(f8[:,::1], f8[:,::1], f8[:,::1])")
def wrench_jacobian_in_heading(jacobian: np.ndarray, rotation_heading_to_world: np.ndarray, turned: np.ndarray) -> None:
    """B^T (18, 28) whose wrench is in the heading frame, into `turned`, from B^T in world axes."""
    for part in range(0, WRENCH_SIZE, 3):
        for row in range(jacobian.shape[1]):
            x, y, z = rotate_back(rotation_heading_to_world, jacobian[part : part + 3, row])
            turned[part, row], turned[part + 1, row], turned[part + 2, row] = x, y, z


@kernel("void(matrix, vector, vector, vector, f8[:,::1], f8[::1])")
def normal_equations(
    jacobian: np.ndarray,
    residual: np.ndarray,
    rows: np.ndarray,
    costs: np.ndarray,
    hessian: np.ndarray,
    right_side: np.ndarray,
) -> None:
    """Eq. (10) without its constraints: minimise 1/2 x^T H x - b^T x with H = B^T W_q^2 B + R and b = B^T W_q^2 r.

    Args:
        jacobian: (18, 28) B^T. Most of it is zero: a wheel loads its own leg and the base alone.
        residual: (28,) r.
        rows: (28,) diagonal of W_q.
        costs: (18,) diagonal of R.
        hessian: (18, 18) H, the result.
        right_side: (18,) b, the result.
    """
    hessian[:] = 0.0
    right_side[:] = 0.0
    for row in range(len(residual)):
        for i in range(len(costs)):
            weighted = rows[row] * rows[row] * jacobian[i, row]
            if weighted != 0.0:
                right_side[i] += weighted * residual[row]
                for j in range(i + 1):
                    hessian[i, j] += weighted * jacobian[j, row]
    for i in range(len(costs)):
        hessian[i, i] += costs[i]
        for j in range(i):
            hessian[j, i] = hessian[i, j]


@kernel("void(matrix, vector, vector, f8[::1])")
def unexplained_residual(jacobian: np.ndarray, wrench: np.ndarray, residual: np.ndarray, unexplained: np.ndarray) -> None:
    """eps = r - B x of eq. (9), (28,), into `unexplained`."""
    unexplained[:] = residual
    for i in range(len(wrench)):
        for row in range(len(residual)):
            unexplained[row] -= wrench[i] * jacobian[i, row]


@kernel("void(f8[:,::1], f8[::1])")
def turn_wrench(rotation_heading_to_world: np.ndarray, wrench: np.ndarray) -> None:
    """Turn a stacked wrench (18,) from world axes into the heading frame, in place."""
    for part in range(0, len(wrench), 3):
        wrench[part], wrench[part + 1], wrench[part + 2] = rotate_back(rotation_heading_to_world, wrench[part : part + 3])


@kernel("void(matrix, f8, f8[:,::1])")
def project_on_friction_cone(forces: np.ndarray, friction: float, projected: np.ndarray) -> None:
    """Nearest forces a wheel can feel: Euclidean projection on the cone |f_xy| <= mu f_z.

    Args:
        forces: (n, 3) N, z along the ground's normal.
        friction: mu > 0.
        projected: (n, 3) N, the results; may be `forces` itself.
    """
    for index in range(len(forces)):
        x, y, z = forces[index, 0], forces[index, 1], forces[index, 2]
        tangential = math.hypot(x, y)
        if tangential > friction * z:
            normal = max((friction * tangential + z) / (1.0 + friction * friction), 0.0)
            shrink = friction * normal / tangential if normal > 0.0 else 0.0
            x, y, z = x * shrink, y * shrink, normal
        projected[index, 0], projected[index, 1], projected[index, 2] = x, y, z


@kernel("b1(f8[:,::1], f8[::1], vector, vector, f8[::1], f8[::1])")
def unconstrained_wrench(
    jacobian: np.ndarray,
    residual: np.ndarray,
    rows: np.ndarray,
    costs: np.ndarray,
    wrench: np.ndarray,
    unexplained: np.ndarray,
) -> bool:
    """Minimum of eq. (10) without its constraints, by Cholesky; False where H is not positive definite.

    Args:
        jacobian: (18, 28) B^T.
        residual: (28,) r.
        rows: (28,) diagonal of W_q.
        costs: (18,) diagonal of R, positive.
        wrench: (18,) x, the result.
        unexplained: (28,) eps, the result.
    """
    hessian = np.empty((WRENCH_SIZE, WRENCH_SIZE))
    normal_equations(jacobian, residual, rows, costs, hessian, wrench)
    if not solve_positive(hessian, wrench):
        return False
    unexplained_residual(jacobian, wrench, residual, unexplained)
    return True


@kernel("b1(f8[:,::1], f8[::1], f8[::1])")
def full_rank_wrench(jacobian: np.ndarray, residual: np.ndarray, wrench: np.ndarray) -> bool:
    """x = B^# r by the normal equations; False where the columns of B depend on each other, or nearly so.

    Args:
        jacobian: (18, 28) B^T.
        residual: (28,) r.
        wrench: (18,) x, the result.
    """
    factor = np.empty((WRENCH_SIZE, WRENCH_SIZE))
    normal_equations(jacobian, residual, _WHOLE, _FREE, factor, wrench)
    if not solve_positive(factor, wrench):
        return False
    pivots = np.diag(factor)
    return pivots.min() > _FULL_RANK_PIVOT * pivots.max()


def pseudo_inverse_wrench(jacobian: np.ndarray, residual: np.ndarray) -> np.ndarray:
    """Minimum-norm least-squares wrench x = B^# r (the paper's GMO-PI).

    Args:
        jacobian: (18, 28) B^T.
        residual: (28,) r.

    Returns:
        (18,) x.
    """
    wrench = np.empty(WRENCH_SIZE)
    if full_rank_wrench(jacobian, residual, wrench):
        return wrench
    pivots = np.zeros(WRENCH_SIZE, dtype=np.int32)
    _, x, _, _, _ = dgelsy(jacobian.T, residual[:, None], pivots, _RANK_TOLERANCE, lwork=600)
    return x[:WRENCH_SIZE, 0]


@value
class WrenchProblem:
    """One instance of eq. (10) as a quadratic form: minimise 1/2 x^T H x - b^T x.

    Attributes:
        hessian: (18, 18) H, positive definite.
        right_side: (18,) b.
    """

    hessian: np.ndarray
    right_side: np.ndarray


def build_wrench_problem(jacobian: np.ndarray, residual: np.ndarray, rows: np.ndarray, costs: np.ndarray) -> WrenchProblem:
    """Eq. (10) without its constraints, see `normal_equations`."""
    problem = WrenchProblem(np.empty((WRENCH_SIZE, WRENCH_SIZE)), np.empty(WRENCH_SIZE))
    normal_equations(jacobian, residual, rows, costs, problem.hessian, problem.right_side)
    return problem
