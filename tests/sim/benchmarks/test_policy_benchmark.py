"""The policy benchmark's bookkeeping: pieces cover a case, add up, and give a row for every mask and level."""

import numpy as np
import pytest

from control.pipeline import PipelineConfig
from sim.benchmarks.box_drag import summary as box_summary
from sim.benchmarks.box_drag import trial_row
from sim.benchmarks.policy import LEVELS_N, Piece, case_rows, cases, pieces, play
from sim.benchmarks.policy_guidance import guidance_bars
from sim.trials.box_drag import DragResult
from sim.trials.guidance_trials import LeadResult
from sim.trials.random_commands import Errors
from sim.trials.trial import TrialSetup, controller_setups


def one_sample(mask: str, level: float, error: float) -> Errors:
    on_force = np.array([flag == "1" for flag in mask])
    return Errors(force={(mask, level): [np.where(on_force, error, np.nan)]}, falls=1, pushes=2, robot_minutes=0.5)


def test_pieces_cover_every_case_under_the_same_seeds():
    plan = pieces(TrialSetup(), seed=7, minutes=20.0, quick=False)
    names = [name for name, _ in cases(TrialSetup())]
    assert list(dict.fromkeys(piece.case for piece in plan)) == names
    for name in names:
        mine = [piece for piece in plan if piece.case == name]
        full = name == "random" or name.startswith("pushes")
        assert sum(piece.minutes for piece in mine) == pytest.approx(20.0 if full else 2.0)
        assert [piece.seed for piece in mine] == [7 + 100 * index for index in range(len(mine))]


def test_pieces_add_up_to_rows_per_mask_and_level():
    total = Errors()
    for mask, level, error in (("001", 10.0, 1.0), ("001", 10.0, 3.0), ("110", 30.0, 2.0)):
        total.add(one_sample(mask, level, error))
    assert (total.falls, total.pushes, total.robot_minutes) == (3, 6, 1.5)
    assert total.force_at(10.0).shape == (2, 3)
    assert total.force_at(20.0).shape == (0, 3)
    rows = case_rows("random", TrialSetup(), total)
    assert [(row["mask"], row["force_level_n"]) for row in rows] == [("any", 10.0), ("any", 30.0), ("001", 10.0), ("110", 30.0)]
    assert rows[0]["rmse_force_n"] == pytest.approx(np.sqrt(5.0))
    assert rows[2]["rmse_force_z_n"] == pytest.approx(np.sqrt(5.0))
    assert np.isnan(float(rows[2]["rmse_force_x_n"] or np.nan))
    assert rows[3]["rmse_force_n"] == pytest.approx(2.0)
    contract = {"controller", "estimator", "mask", "force_level_n", "mass_scale", "rmse_velocity_mps", "rmse_yaw_rps"}
    contract |= {"settled_position_cm", "rmse_force_n", "falls", "robot_minutes"}
    assert all(contract <= row.keys() for row in rows)


def test_every_trial_runs_the_stack_that_ships():
    assert TrialSetup().estimator == PipelineConfig().estimator
    rows = [
        trial_row(TrialSetup(), 3, DragResult(1.0, 2.0, -0.2, 0.2, True)),
        *case_rows("random", TrialSetup(), one_sample("001", 10.0, 1.0)),
    ]
    assert {row["estimator"] for row in rows} == {PipelineConfig().estimator}
    contract = ("controller", "estimator", "mass_scale", "trial", "e_y_n", "e_z_n", "y_min_m", "y_max_m")
    assert tuple(rows[0])[: len(contract)] == contract


@pytest.mark.slow
def test_a_piece_with_pushes_counts_them_and_judges_by_truth():
    piece, errors = play(Piece("pushes", TrialSetup(push_n=15.0), 3, 0.02))
    assert piece.case == "pushes"
    assert errors.pushes == 1
    assert errors.robot_minutes >= 0.02
    assert {level for _, level in errors.force} <= set(LEVELS_N)
    assert len(errors.forward) == len(errors.power)


def test_the_model_based_controller_is_always_there(tmp_path):
    assert list(controller_setups(tmp_path)) == ["model_based"]


def test_a_controller_that_is_heavier_to_lead_on_average_misses_the_bar():
    def leads(*forces: float) -> list[LeadResult]:
        return [LeadResult(0.5, 0.4, force, 0.1, 0.3, False) for force in forces]

    reference = leads(8.0, 9.0, 13.0, 9.0)
    (light,) = guidance_bars("policy", leads(8.5, 8.5, 12.5, 9.0), reference)
    (heavy,) = guidance_bars("policy", leads(8.5, 8.5, 13.5, 9.0), reference)
    assert (light.value, heavy.value) == (pytest.approx(-0.125), pytest.approx(0.125))
    assert (light.holds, heavy.holds) == (True, False)


def test_box_rows_tell_lost_contact():
    row = box_summary(TrialSetup("policy"), [DragResult(1.0, 2.0, -0.2, 0.2, True), DragResult(2.0, 2.0, -0.1, 0.3, False)])
    assert (row["e_y_n"], row["contact_lost"], row["trials"]) == (1.5, 1, 2)
    assert row["e_y_sd_n"] == pytest.approx(np.sqrt(0.5))
