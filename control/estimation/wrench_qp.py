"""Contact-constrained wrench projection, the quadratic program of paper eq. (10), solved by Clarabel.

    minimise 1/2 |W_q (r - B x)|^2 + 1/2 x^T R x   subject to every wheel force lying in its friction cone

On the ground under the wheels the constraints never change, so a problem is only its Hessian and its gradient. Where the
minimum without constraints obeys them, which on a standing robot it mostly does, it is the answer.
"""

import math
from dataclasses import dataclass
from enum import Enum

import clarabel
import numpy as np
from scipy import sparse

from control.estimation.wrench_projection import WrenchProblem
from control.joints import LEGS, WHEEL_FRICTION
from control.kernels.compiled import kernel
from control.kernels.small_algebra import solve_positive
from control.robot_model import WRENCH_SIZE

_WHEELS = len(LEGS)

_UPPER_ROWS, _UPPER_COLUMNS = (indices.T.ravel() for indices in np.mgrid[:WRENCH_SIZE, :WRENCH_SIZE])
_UPPER = _UPPER_ROWS <= _UPPER_COLUMNS
_UPPER_ROWS, _UPPER_COLUMNS = _UPPER_ROWS[_UPPER], _UPPER_COLUMNS[_UPPER]


class FrictionCone(Enum):
    """Shape of the friction constraint."""

    PYRAMID = "pyramid"
    SECOND_ORDER = "second_order"


@dataclass(frozen=True, slots=True)
class ContactConstraints:
    """Unilateral contact and friction of the four wheels, A_c x in K.

    Attributes:
        friction: mu > 0.
        cone: PYRAMID, inscribed in the cone and aligned with the heading frame, or SECOND_ORDER, the cone itself.
    """

    friction: float = WHEEL_FRICTION
    cone: FrictionCone = FrictionCone.PYRAMID

    def __post_init__(self) -> None:
        if not self.friction > 0.0:
            raise ValueError(f"friction must be positive, got {self.friction}")

    def matrix(self) -> np.ndarray:
        """A_c (m, 18) with A_c x <= 0: per wheel 5 rows (-f_z, +-f_x, +-f_y), or 3 rows (mu f_z, f_x, f_y) negated."""
        if self.cone is FrictionCone.PYRAMID:
            slope = self.friction / np.sqrt(2.0)
            block = np.array([[0, 0, -1], [1, 0, -slope], [-1, 0, -slope], [0, 1, -slope], [0, -1, -slope]], dtype=float)
        else:
            block = -np.array([[0, 0, self.friction], [1, 0, 0], [0, 1, 0]], dtype=float)
        matrix = np.zeros((len(block) * len(LEGS), WRENCH_SIZE))
        matrix[:, : 3 * len(LEGS)] = np.kron(np.eye(len(LEGS)), block)
        return matrix

    def violation_n(self, wrench: np.ndarray) -> float:
        """Largest excess, N, of a wheel force over its constraint; 0 when feasible."""
        return largest_excess(wrench, self.friction, self.cone is FrictionCone.PYRAMID)


@kernel("f8(vector, f8, b1)")
def largest_excess(wrench: np.ndarray, friction: float, pyramid: bool) -> float:
    """Largest excess, N, of a wheel force in a stacked wrench (18,) over its friction pyramid or cone; 0 when feasible."""
    excess = 0.0
    for wheel in range(_WHEELS):
        x, y, z = wrench[3 * wheel], wrench[3 * wheel + 1], wrench[3 * wheel + 2]
        if pyramid:
            tangential, limit = max(abs(x), abs(y)), friction / math.sqrt(2.0) * z
        else:
            tangential, limit = math.hypot(x, y), friction * z
        excess = max(excess, tangential - limit, -z)
    return excess


@kernel("b1(matrix, vector, f8[::1])")
def unconstrained_minimum(hessian: np.ndarray, right_side: np.ndarray, x: np.ndarray) -> bool:
    """x (n,) = H^-1 b; whether H is positive definite and the result finite."""
    x[:] = right_side
    return solve_positive(hessian.copy(), x) and math.isfinite(x.sum())


class WrenchProjectionError(RuntimeError):
    """The projection found no solution.

    Attributes:
        problem: the instance, or None where the data was not even fit to build one.
        status: what the solver said.
    """

    def __init__(self, problem: WrenchProblem | None, status: str) -> None:
        super().__init__(f"wrench projection unsolved: {status}; reset the estimator if this persists")
        self.problem = problem
        self.status = status


class WrenchSolver:
    """Clarabel workspace for problems under the same constraints; data is updated in place between solves."""

    def __init__(self, constraints: ContactConstraints, max_iterations: int = 50) -> None:
        """Args:
        constraints: of the wheel forces.
        max_iterations: of the interior-point method; 11 to 15 are usual.
        """
        self._constraints = constraints
        # Relative and absolute, on feasibility and duality gap. Second-order programs stall below.
        self._tolerance = tolerance = 1e-12 if constraints.cone is FrictionCone.PYRAMID else 1e-10
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        settings.max_iter = max_iterations
        settings.presolve_enable = False  # in-place updates need the problem as it was given
        settings.chordal_decomposition_enable = False
        # R > 0 makes the KKT matrix quasi-definite: it factorises as it is, without regularisation to refine away.
        settings.static_regularization_enable = False
        settings.max_step_fraction = 0.95  # the default 0.99 stalls on one second-order program in a thousand
        settings.tol_feas = settings.tol_gap_abs = settings.tol_gap_rel = tolerance
        matrix = constraints.matrix()
        if constraints.cone is FrictionCone.PYRAMID:
            cones = [clarabel.NonnegativeConeT(len(matrix))]
        else:
            cones = [clarabel.SecondOrderConeT(3) for _ in LEGS]
        pattern = sparse.csc_matrix(
            (np.ones(len(_UPPER_ROWS)), (_UPPER_ROWS, _UPPER_COLUMNS)), shape=(WRENCH_SIZE, WRENCH_SIZE)
        )
        self._solver = clarabel.DefaultSolver(
            pattern, np.zeros(WRENCH_SIZE), sparse.csc_matrix(matrix), np.zeros(len(matrix)), cones, settings
        )
        self._inactive = np.zeros(len(matrix))

    def solve(self, problem: WrenchProblem) -> tuple[np.ndarray, np.ndarray]:
        """Solve one instance.

        Returns:
            x (18,) and the multipliers z (m,) of the constraints, with H x - b + A^T z = 0.

        Raises:
            WrenchProjectionError: the data is not finite or H not positive definite, the solver stopped early, or its answer
                violates a cone.
        """
        x = np.empty(WRENCH_SIZE)
        if not unconstrained_minimum(problem.hessian, problem.right_side, x):
            raise WrenchProjectionError(problem, "data is not finite, or H is not positive definite")
        if self._constraints.violation_n(x) == 0.0:
            return x, self._inactive.copy()
        self._solver.update(P=problem.hessian[_UPPER_ROWS, _UPPER_COLUMNS], q=-problem.right_side)
        solution = self._solver.solve()
        if solution.status != clarabel.SolverStatus.Solved:
            raise WrenchProjectionError(problem, str(solution.status))
        x = np.array(solution.x)
        # A solver may call an infeasible point solved, so feasibility is checked here too.
        violation = self._constraints.violation_n(x)
        if violation > 1e3 * self._tolerance * (1.0 + np.abs(x).max()):
            raise WrenchProjectionError(problem, f"solver's answer violates a friction cone by {violation:.2g} N")
        return x, np.array(solution.z)
