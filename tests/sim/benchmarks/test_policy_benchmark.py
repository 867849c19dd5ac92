"""The policy benchmark's bookkeeping: pieces cover a case, add up, and give a row for every mask and level."""

import numpy as np
import pytest

from sim.benchmarks.box_drag import summary as box_summary
from sim.benchmarks.policy import LEVELS_N, Piece, cases, mask_rows, pieces, play, summary
from sim.benchmarks.policy_guidance import guidance_bars
from sim.trials.guidance_trials import LeadResult
from sim.trials.policy_trials import DragResult, Errors, TrialSetup, controller_setups


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
    low, high = mask_rows("model_based", total)
    assert (low["case"], high["case"]) == ("mask 001 at 10 N", "mask 110 at 30 N")
    assert low["rmse_force_z_n"] == pytest.approx(np.sqrt(5.0))
    assert np.isnan(float(low["rmse_force_x_n"] or np.nan))
    row = summary("random", TrialSetup(), total)
    assert row["rmse_force_30n_n"] == pytest.approx(2.0)


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
    row = box_summary("policy", 1.0, [DragResult(1.0, 2.0, -0.2, 0.2, True), DragResult(2.0, 2.0, -0.1, 0.3, False)])
    assert (row["error_y_n"], row["contact_lost"], row["trials"]) == (1.5, 1, 2)
    assert row["error_y_std_n"] == pytest.approx(np.sqrt(0.5))
