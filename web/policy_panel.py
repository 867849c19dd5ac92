"""What the selected learned policy observes and does, part by part; hidden while another controller is selected."""

import time
from functools import cache

import numpy as np
import viser

from control.joints import ARM_SLICE, LEG_SLICE, WHEEL_SLICE
from control.policy.observation import Observation
from web import theme

PERIOD_S = 0.25
SPAN = 2.0
"""Bars end here; the number beside them tells how far a value goes."""

_ACTION = {"legs": LEG_SLICE, "wheels": WHEEL_SLICE, "arm": ARM_SLICE}


@cache
def observation_groups(form: str) -> dict[str, slice]:
    """Parts of the observation of one form, by name."""
    return Observation(form).groups


def bars_svg(values: np.ndarray, color: theme.RGB) -> str:
    """One bar per value (n,), up for positive and down for negative."""
    heights = np.clip(values / SPAN, -1.0, 1.0)
    path = "".join(f"M{index} 1h.8v{-height:.2f}h-.8z" for index, height in enumerate(heights))
    return (
        f'<svg viewBox="0 0 {len(values)} 2" preserveAspectRatio="none" style="width:100%;height:1.3em;display:block">'
        f'<path d="M0 .99h{len(values)}v.02H0z" fill="{theme.FAINT}"/><path d="{path}" fill="{theme.css(color)}"/></svg>'
    )


def _rows(title: str, values: np.ndarray, groups: dict[str, slice], color: theme.RGB) -> str:
    rows = [f'<tr><td colspan="3" style="padding-top:0.5em"><b>{title}</b></td></tr>']
    for name, where in groups.items():
        part = values[where]
        rows.append(
            f'<tr><td style="width:45%;color:{theme.FAINT}">{name.replace("_", " ")}</td><td>{bars_svg(part, color)}</td>'
            f'<td align="right" style="width:3em">{np.abs(part).max():.1f}</td></tr>'
        )
    return "".join(rows)


def policy_html(snapshot: np.void) -> str:
    """Observation and action of a SNAPSHOT record in which a policy is selected."""
    rows = _rows(
        "Observation", snapshot["policy_observation"], observation_groups(snapshot["policy_form"].decode()), theme.ESTIMATED
    ) + _rows("Action", snapshot["policy_action"], _ACTION, theme.COMMANDED)
    return (
        f'<div style="{theme.SMALL_TEXT}" data-forcelens="policy">Scaled as the network sees them; bars span '
        f'&plusmn;{SPAN:.0f}, numbers are the largest.<table style="width:100%">{rows}</table></div>'
    )


class PolicyPanel:
    """A folder with the policy's observation and action; build it inside the container that shall hold it."""

    def __init__(self, gui: viser.GuiApi) -> None:
        self.folder = gui.add_folder("Policy", visible=False)
        with self.folder:
            self.table = gui.add_html("")
        self._next_s = 0.0

    def update(self, snapshot: np.void) -> None:
        """Show the policy of a SNAPSHOT record, if one is selected."""
        selected = bool(snapshot["policy_form"])
        now = time.monotonic()
        if selected and now >= self._next_s:
            self._next_s = now + PERIOD_S
            self.table.content = policy_html(snapshot)
        if self.folder.visible != selected:
            self.folder.visible = selected
