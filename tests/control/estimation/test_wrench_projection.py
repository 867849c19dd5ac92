"""Pseudo-inverse, regularised least squares and the contact-constrained program against independent solutions."""

from collections.abc import Callable

import numpy as np
import pytest
import quadprog
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear, minimize

from control.estimation.wrench_projection import (
    FORCE_ROWS,
    MOMENT_ROWS,
    SUPPORT_ROWS,
    ProjectionWeights,
    WrenchProblem,
    build_wrench_problem,
    project_on_friction_cone,
    pseudo_inverse_wrench,
    turn_wrench,
    unconstrained_wrench,
    wrench_jacobian_in_heading,
)
from control.estimation.wrench_qp import ContactConstraints, FrictionCone, WrenchProjectionError, WrenchSolver
from control.joints import JOINT_COUNT, NOMINAL_POSITION
from control.robot_model import WRENCH_SIZE, RobotModel

MODEL = RobotModel()
WEIGHTS = ProjectionWeights()
ROWS, COSTS = WEIGHTS.rows(MODEL), WEIGHTS.costs()
STANDING = np.array([3.0, 1, 50, 2, -1, 55, 0, 2, 60, -2, 0, 52, 5, -4, 12, 0, 0, 0])


def jacobian_at(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    position = NOMINAL_POSITION + 0.2 * rng.normal(size=JOINT_COUNT)
    MODEL.update_configuration(np.eye(3), position)
    return MODEL.wrench_jacobian.copy()


def regularised_wrench(jacobian: np.ndarray, residual: np.ndarray, costs: np.ndarray = COSTS) -> np.ndarray:
    wrench, unexplained = np.empty(WRENCH_SIZE), np.empty(28)
    assert unconstrained_wrench(jacobian, residual, ROWS, costs, wrench, unexplained)
    np.testing.assert_allclose(unexplained, residual - wrench @ jacobian, atol=1e-10)
    return wrench


def hard_problem(seed: int, scale_n: float = 40.0) -> WrenchProblem:
    """A residual whose unconstrained wheel forces leave their cones."""
    rng = np.random.default_rng(seed)
    jacobian = jacobian_at(seed)
    residual = jacobian.T @ rng.normal(size=WRENCH_SIZE) * scale_n + rng.normal(size=28)
    return build_wrench_problem(jacobian, residual, ROWS, COSTS)


@pytest.mark.parametrize("seed", range(5))
def test_pseudo_inverse_is_moore_penrose(seed: int) -> None:
    jacobian = jacobian_at(seed)
    residual = np.random.default_rng(seed).normal(size=28)
    np.testing.assert_allclose(pseudo_inverse_wrench(jacobian, residual), np.linalg.pinv(jacobian.T) @ residual, atol=1e-9)


def test_pseudo_inverse_takes_the_smallest_wrench_where_columns_depend() -> None:
    jacobian = jacobian_at(0)
    jacobian[3:6] = jacobian[:3]
    residual = jacobian.T @ STANDING
    x = pseudo_inverse_wrench(jacobian, residual)
    np.testing.assert_allclose(x, np.linalg.pinv(jacobian.T) @ residual, atol=1e-8)
    np.testing.assert_allclose(x[:3], x[3:6], atol=1e-9)


def test_wrenches_in_heading_do_not_depend_on_the_yaw_of_the_world() -> None:
    rng = np.random.default_rng(4)
    position = NOMINAL_POSITION + 0.1 * rng.normal(size=JOINT_COUNT)
    jacobians = []
    for yaw in (0.0, 2.1):
        c, s = np.cos(yaw), np.sin(yaw)
        heading = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        MODEL.update_configuration(heading, position)
        turned = np.empty((WRENCH_SIZE, 28))
        wrench_jacobian_in_heading(MODEL.wrench_jacobian, heading, turned)
        jacobians.append(turned)
        in_world, in_heading = STANDING.reshape(-1, 3) @ heading.T, STANDING.copy()
        np.testing.assert_allclose(MODEL.wrench_jacobian.T @ in_world.ravel(), turned.T @ in_heading, atol=1e-9)
        back = in_world.ravel()
        turn_wrench(heading, back)
        np.testing.assert_allclose(back, in_heading, atol=1e-12)
    np.testing.assert_allclose(jacobians[0], jacobians[1], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_regularised_least_squares_is_the_stacked_problem(seed: int) -> None:
    rng = np.random.default_rng(seed)
    jacobian, residual = jacobian_at(seed), 30 * rng.normal(size=28)
    stacked = np.vstack([ROWS[:, None] * jacobian.T, np.diag(np.sqrt(COSTS))])
    expected = np.linalg.lstsq(stacked, np.concatenate([ROWS * residual, np.zeros(WRENCH_SIZE)]), rcond=None)[0]
    np.testing.assert_allclose(regularised_wrench(jacobian, residual), expected, atol=1e-7)


def test_a_hessian_that_is_not_positive_definite_is_refused() -> None:
    jacobian = jacobian_at(0)
    wrench, unexplained = np.empty(WRENCH_SIZE), np.empty(28)
    assert not unconstrained_wrench(jacobian, np.ones(28), ROWS, -np.ones(WRENCH_SIZE), wrench, unexplained)
    with pytest.raises(WrenchProjectionError, match="positive definite"):
        WrenchSolver(ContactConstraints()).solve(WrenchProblem(-np.eye(WRENCH_SIZE), np.ones(WRENCH_SIZE)))


@pytest.mark.parametrize("seed", range(3))
def test_every_projection_recovers_a_feasible_wrench(seed: int) -> None:
    jacobian = jacobian_at(seed)
    residual = jacobian.T @ STANDING
    costs = ProjectionWeights(support_cost=1e-9, force_cost=1e-9).costs()
    problem = build_wrench_problem(jacobian, residual, ROWS, costs)
    np.testing.assert_allclose(pseudo_inverse_wrench(jacobian, residual), STANDING, atol=1e-8)
    np.testing.assert_allclose(regularised_wrench(jacobian, residual, costs), STANDING, atol=1e-2)
    for cone in FrictionCone:
        x, _ = WrenchSolver(ContactConstraints(cone=cone)).solve(problem)
        np.testing.assert_allclose(x, STANDING, atol=1e-2)


def test_moment_prior_explains_a_moment_by_a_force() -> None:
    jacobian = jacobian_at(1)
    wrench = STANDING.copy()
    wrench[MOMENT_ROWS] = [0.3, -0.2, 0.1]
    x = regularised_wrench(jacobian, jacobian.T @ wrench)
    assert np.abs(x[MOMENT_ROWS]).max() < 0.02 * 0.3
    np.testing.assert_allclose(x[FORCE_ROWS], wrench[FORCE_ROWS], atol=2.0)


@pytest.mark.parametrize("cone", FrictionCone)
@pytest.mark.parametrize("seed", range(6))
def test_solution_satisfies_the_kkt_conditions(cone: FrictionCone, seed: int) -> None:
    constraints = ContactConstraints(cone=cone)
    problem = hard_problem(seed)
    x, z = WrenchSolver(constraints).solve(problem)
    matrix = constraints.matrix()
    scale = np.abs(problem.right_side).max()
    np.testing.assert_allclose(problem.hessian @ x - problem.right_side + matrix.T @ z, 0, atol=1e-6 * scale)
    assert abs(z @ (matrix @ x)) < 1e-5 * scale * np.abs(x).max()
    if cone is FrictionCone.PYRAMID:
        assert z.min() > -1e-6 * scale
    else:
        multipliers = z.reshape(-1, 3)
        assert (np.hypot(multipliers[:, 1], multipliers[:, 2]) <= multipliers[:, 0] + 1e-6 * scale).all()


@pytest.mark.parametrize("scale_n", [5.0, 40.0, 500.0])
@pytest.mark.parametrize("seed", range(10))
def test_the_objective_is_the_optimum(seed: int, scale_n: float) -> None:
    problem, constraints = hard_problem(seed, scale_n), ContactConstraints()
    matrix = constraints.matrix()
    x, _ = WrenchSolver(constraints).solve(problem)
    _, optimum, *_ = quadprog.solve_qp(problem.hessian, problem.right_side, -matrix.T, np.zeros(len(matrix)))
    objective = 0.5 * x @ problem.hessian @ x - problem.right_side @ x
    assert objective - optimum <= 1e-8 + 1e-11 * abs(optimum)


def test_a_minimum_within_the_cones_is_the_answer_with_no_multiplier() -> None:
    jacobian = jacobian_at(2)
    problem = build_wrench_problem(jacobian, jacobian.T @ STANDING, ROWS, COSTS)
    for cone in FrictionCone:
        x, z = WrenchSolver(ContactConstraints(cone=cone)).solve(problem)
        np.testing.assert_allclose(problem.hessian @ x, problem.right_side, rtol=1e-9, atol=1e-9)
        assert ContactConstraints(cone=cone).violation_n(x) == 0.0
        np.testing.assert_array_equal(z, 0.0)


def solve_pyramid_by_generators(problem: WrenchProblem, constraints: ContactConstraints) -> np.ndarray:
    """The pyramid is spanned by its four edges, which turns eq. (10) into bounded least squares."""
    slope = constraints.friction / np.sqrt(2)
    edges = np.array([[a * slope, b * slope, 1.0] for a in (1, -1) for b in (1, -1)]).T
    span = np.zeros((WRENCH_SIZE, 22))
    span[SUPPORT_ROWS, :16] = np.kron(np.eye(4), edges)
    span[12:, 16:] = np.eye(6)
    factor = np.linalg.cholesky(problem.hessian).T
    target = np.linalg.solve(factor.T, problem.right_side)
    lower = np.r_[np.zeros(16), np.full(6, -np.inf)]
    result = lsq_linear(factor @ span, target, bounds=(lower, np.inf), method="bvls", tol=1e-14, max_iter=500)
    return span @ result.x


def solve_cone_by_slsqp(problem: WrenchProblem, constraints: ContactConstraints) -> np.ndarray:
    """The cone as smooth inequalities mu^2 f_z^2 - f_x^2 - f_y^2 >= 0 and f_z >= 0."""

    def margins(x: np.ndarray) -> np.ndarray:
        forces = x[SUPPORT_ROWS].reshape(4, 3)
        return np.concatenate([(constraints.friction * forces[:, 2]) ** 2 - (forces[:, :2] ** 2).sum(1), forces[:, 2]])

    start = np.zeros(WRENCH_SIZE)
    start[2:12:3] = 50.0
    result = minimize(
        lambda x: 0.5 * x @ problem.hessian @ x - problem.right_side @ x,
        start,
        jac=lambda x: problem.hessian @ x - problem.right_side,
        constraints={"type": "ineq", "fun": margins},
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-12},
    )
    return result.x


@pytest.mark.parametrize(
    "cone, reference, tolerance_n",
    [(FrictionCone.PYRAMID, solve_pyramid_by_generators, 1e-3), (FrictionCone.SECOND_ORDER, solve_cone_by_slsqp, 0.05)],
)
@pytest.mark.parametrize("seed", range(6))
def test_solution_agrees_with_another_solver(
    seed: int,
    cone: FrictionCone,
    reference: Callable[[WrenchProblem, ContactConstraints], np.ndarray],
    tolerance_n: float,
) -> None:
    constraints = ContactConstraints(cone=cone)
    problem = hard_problem(seed)
    x, _ = WrenchSolver(constraints).solve(problem)
    expected = reference(problem, constraints)

    def cost(y: np.ndarray) -> float:
        return float(0.5 * y @ problem.hessian @ y - problem.right_side @ y)

    assert cost(x) <= cost(expected) + 1e-5 * abs(cost(expected))
    np.testing.assert_allclose(x[FORCE_ROWS], expected[FORCE_ROWS], atol=tolerance_n)


SOLVERS = {cone: WrenchSolver(ContactConstraints(0.6, cone)) for cone in FrictionCone}


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 10_000), scale_n=st.floats(0.0, 500.0), cone=st.sampled_from(FrictionCone))
def test_cone_is_never_violated(seed: int, scale_n: float, cone: FrictionCone) -> None:
    problem = hard_problem(seed, scale_n)
    x, _ = SOLVERS[cone].solve(problem)
    assert ContactConstraints(0.6, cone).violation_n(x) <= 1e-5 * (1 + np.abs(x).max())


def test_solving_again_in_place_equals_a_fresh_solver() -> None:
    used = WrenchSolver(ContactConstraints())
    for seed in range(4):
        used.solve(hard_problem(seed))
    fresh = WrenchSolver(ContactConstraints())
    np.testing.assert_allclose(used.solve(hard_problem(9))[0], fresh.solve(hard_problem(9))[0], atol=1e-3)


def test_an_unsolved_problem_raises_with_the_problem() -> None:
    problem = hard_problem(0)
    with pytest.raises(WrenchProjectionError, match="unsolved") as caught:
        WrenchSolver(ContactConstraints(), max_iterations=2).solve(problem)
    assert caught.value.problem is problem
    poisoned = WrenchProblem(problem.hessian, problem.right_side * np.nan)
    with pytest.raises(WrenchProjectionError, match="finite"):
        WrenchSolver(ContactConstraints()).solve(poisoned)


def test_friction_must_be_positive() -> None:
    with pytest.raises(ValueError, match="friction"):
        ContactConstraints(friction=0.0)


@settings(max_examples=100, deadline=None)
@given(
    force=st.tuples(*[st.floats(-100, 100)] * 3),
    friction=st.floats(0.2, 1.5),
    angle=st.floats(0, 2 * np.pi),
    reach=st.floats(0, 1),
    normal=st.floats(0, 100),
)
def test_cone_projection_is_the_nearest_feasible_force(
    force: tuple[float, float, float], friction: float, angle: float, reach: float, normal: float
) -> None:
    asked = np.array([force])
    nearest = np.empty((1, 3))
    project_on_friction_cone(asked, friction, nearest)
    assert np.hypot(nearest[0, 0], nearest[0, 1]) <= friction * nearest[0, 2] + 1e-9
    feasible = normal * np.array([reach * friction * np.cos(angle), reach * friction * np.sin(angle), 1.0])
    assert np.linalg.norm(asked - nearest) <= np.linalg.norm(asked - feasible) + 1e-9
