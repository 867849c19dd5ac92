"""The pipeline against what it gave before its laws were compiled, on 5000 recorded ticks of everything it does."""

import numpy as np
import pytest
import quadprog

from control.estimation.registry import MODEL_BASED_NAMES
from control.estimation.wrench_projection import WrenchProblem
from control.estimation.wrench_qp import ContactConstraints, WrenchSolver
from control.faults import Fault
from tests.golden.golden_pipeline import BOX, FREE, GOLDEN, MODEL_BASED, PAPER, TICKS, replay

DOUBLE, SINGLE = 1e-9, 1e-5
"""Allowed |difference| / (1 + |value|) where everything is computed in double precision, and where a network in single
precision takes part: its sums depend on their order."""

ALLOWED = {
    "base_velocity": DOUBLE,
    "base_height": DOUBLE,
    "hand": DOUBLE,
    "gmo_pi.force": DOUBLE,
    "gmo_pi.wheel_forces": DOUBLE,
    "adaptive.force": DOUBLE,
    "adaptive.wheel_forces": DOUBLE,
    "adaptive.mass_scale": DOUBLE,
    "tcn.force": SINGLE,
    "hybrid.force": SINGLE,
    "hybrid.sigma": SINGLE,
    "selected_force": SINGLE,
    "applied": SINGLE,
    "target_position": SINGLE,
    "target_velocity": SINGLE,
    # Recorded while the quadratic program was solved to 1e-4 of its optimum, along which wheel forces hardly cost anything.
    "gmo_cqp.force": 5e-3,
    "gmo_cqp.wheel_forces": 2e-2,
    "hybrid_paper.force": 5e-3,
}
SHOWN_ANEW = ("gmo_cqp.force", "gmo_cqp.wheel_forces")
"""Recorded while gmo_cqp was shown in a slot of its own. It is now in that of hybrid_paper, which contains its estimate, so
that the program is solved once for both; and a stale estimate, of which there is one, repeats that of another tick."""
EXACT = ("faults", *(f"{name}.stale" for name in MODEL_BASED_NAMES))
FREE_OF_NETWORKS = slice(FREE.ticks, FREE.ticks + MODEL_BASED.ticks)
"""Ticks at which controller and selected estimator compute in double precision."""


@pytest.fixture(scope="module")
def golden() -> dict[str, np.ndarray]:
    with np.load(GOLDEN) as archive:
        return {name: archive[name] for name in archive.files}


@pytest.fixture(scope="module")
def programs() -> list[tuple[WrenchProblem, np.ndarray]]:
    """Every program that the replay solves, and its answer."""
    return []


@pytest.fixture(scope="module")
def now(golden: dict[str, np.ndarray], programs: list[tuple[WrenchProblem, np.ndarray]]) -> dict[str, np.ndarray]:
    solve = WrenchSolver.solve

    def noted(solver: WrenchSolver, problem: WrenchProblem) -> tuple[np.ndarray, np.ndarray]:
        answer = solve(solver, problem)
        programs.append((problem, answer[0]))
        return answer

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(WrenchSolver, "solve", noted)
        return replay(golden["frames"])


def difference(now: np.ndarray, golden: np.ndarray) -> float:
    return float(np.max(np.abs(now - golden) / (1.0 + np.abs(golden))))


def test_nothing_golden_goes_uncompared(golden: dict[str, np.ndarray], now: dict[str, np.ndarray]) -> None:
    assert len(golden["frames"]) == TICKS == 5000
    assert set(golden) == {"frames", *ALLOWED, *EXACT} == {"frames", *now}


@pytest.mark.parametrize("name", ALLOWED)
def test_values_equal_the_golden_ones(name: str, golden: dict[str, np.ndarray], now: dict[str, np.ndarray]) -> None:
    rows = slice(None)
    if name in SHOWN_ANEW:
        rows = ~golden["gmo_cqp.stale"][:, 0]
    assert difference(now[name][rows], golden[name][rows]) <= ALLOWED[name]


@pytest.mark.parametrize("name", ["selected_force", "applied", "target_position", "target_velocity"])
def test_without_networks_everything_agrees_in_double_precision(
    name: str, golden: dict[str, np.ndarray], now: dict[str, np.ndarray]
) -> None:
    rows = np.linspace(0, TICKS, len(golden[name]), endpoint=False)
    stretch = (rows >= FREE_OF_NETWORKS.start) & (rows < FREE_OF_NETWORKS.stop)
    assert difference(now[name][stretch], golden[name][stretch]) <= DOUBLE


@pytest.mark.usefixtures("now")
def test_every_quadratic_program_is_solved_to_1e_8_of_its_optimum(programs: list[tuple[WrenchProblem, np.ndarray]]) -> None:
    """Against an active-set method, which is exact."""
    constraints = ContactConstraints()
    matrix = constraints.matrix()
    active = 0
    for problem, x in programs:
        hessian, right_side = problem.hessian, problem.right_side
        best, _, unconstrained, *_ = quadprog.solve_qp(hessian, right_side, -matrix.T, np.zeros(len(matrix)))
        active += bool((matrix @ unconstrained > 0.0).any())
        assert constraints.violation_n(x) < 1e-9
        assert 0.5 * x @ hessian @ x - right_side @ x <= 0.5 * best @ hessian @ best - right_side @ best + 1e-8
    assert len(programs) > 900 and active > 30, "the recording holds too few programs with active constraints"


@pytest.mark.parametrize("name", EXACT)
def test_faults_and_stale_estimates_come_at_the_same_ticks(
    name: str, golden: dict[str, np.ndarray], now: dict[str, np.ndarray]
) -> None:
    np.testing.assert_array_equal(now[name], golden[name])


def test_the_recording_meets_what_it_is_to_cover(golden: dict[str, np.ndarray]) -> None:
    """Guidance, force control on every axis, a contact, a fault, a limited force and a robot heavier than its model."""
    faults, applied, force = golden["faults"][:, 0], golden["applied"], golden["selected_force"]
    told = {Fault.NONE, Fault.TIP_OVER_LIMIT, Fault.TORQUE_LIMIT, Fault.NOT_FINITE | Fault.ESTIMATOR_STALE}
    assert told == set(faults)
    assert (applied[:, :3].max(axis=0) == 1.0).all()
    assert np.abs(applied[:, 13:]).max(axis=0).min() > 0.05, "the base was asked for every velocity"
    box = slice(TICKS - PAPER.ticks - BOX.ticks + 600, TICKS - PAPER.ticks - 150)
    assert np.median(force[box, 2]) > 10.0, "the hand lay on the box"
    assert golden["adaptive.mass_scale"].max() > 1.07 > 0.95 > golden["adaptive.mass_scale"].min()
    assert all(golden[f"{name}.stale"].any() for name in MODEL_BASED_NAMES)
