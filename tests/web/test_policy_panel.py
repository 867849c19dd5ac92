"""What the page shows of a learned policy."""

import re

import numpy as np
import pytest
import viser

from control.policy.observation import EXTENDED_FORM, PAPER_FORM, RESIDUAL_FORM, Observation
from sim.runtime.snapshot import MAX_OBSERVATION
from web.policy_panel import SPAN, PolicyPanel, bars_svg, policy_html
from web.theme import ESTIMATED

FORMS = (PAPER_FORM, EXTENDED_FORM, RESIDUAL_FORM)


@pytest.mark.parametrize("form", FORMS)
def test_every_part_of_the_observation_is_shown_with_its_largest_value(snapshot: np.void, form: str) -> None:
    groups = Observation(form).groups
    snapshot["policy_form"] = form
    for index, where in enumerate(groups.values()):
        snapshot["policy_observation"][where] = -index / 10.0
    snapshot["policy_action"][-1] = 7.7
    text = policy_html(snapshot)
    shown = dict(re.findall(r">([a-z ]+)</td><td><svg.*?</svg></td><td[^>]*>([\d.]+)</td>", text))
    assert {name.replace("_", " "): f"{index / 10.0:.1f}" for index, name in enumerate(groups)}.items() <= shown.items()
    assert (shown["legs"], shown["arm"]) == ("0.0", "7.7")


def test_bars_point_the_way_of_their_sign_and_end_at_the_span() -> None:
    heights = [float(each) for each in re.findall(r"h\.8v(-?[\d.]+)", bars_svg(np.array([1.0, -1.0, 99.0]) * SPAN, ESTIMATED))]
    assert heights == [-1.0, 1.0, -1.0]


def test_it_is_hidden_while_no_policy_is_selected(server: viser.ViserServer, snapshot: np.void) -> None:
    panel = PolicyPanel(server.gui)
    panel.update(snapshot)
    assert not panel.folder.visible
    snapshot["policy_form"] = PAPER_FORM
    panel.update(snapshot)
    assert panel.folder.visible
    assert "gait phase" in panel.table.content
    snapshot["policy_form"] = b""
    panel.update(snapshot)
    assert not panel.folder.visible


@pytest.mark.parametrize("form", FORMS)
def test_every_form_fits_into_the_snapshot(form: str) -> None:
    assert Observation(form).size <= MAX_OBSERVATION
