"""One field of the mismatch changes alone: whoever moves one slider has not asked for anything else."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from server.control_client import ControlClient
from server.control_process import ControlLaunch
from server.errors import InvalidFieldError
from server.operator import Operator
from sim.recording import tap


def test_what_is_left_out_stays_and_what_is_refused_changes_nothing() -> None:
    calls: list[dict[str, Any]] = []
    client = SimpleNamespace(
        write_setpoint=lambda **_: None,
        unheard_s=lambda: 0.0,
        tap_memory=tap.allocate(),
        call=lambda _event, _timeout_s, **fields: calls.append(fields),
    )
    operator = Operator(cast(ControlClient, client), ControlLaunch())
    operator.set_mismatch(mass_scale=1.2, per_link={"base": 1.1})
    operator.set_mismatch(payload_kg=0.75, payload_center_m=[0.05, 0.0, 0.0])
    with pytest.raises(InvalidFieldError, match="payload_kg"):
        operator.set_mismatch(payload_kg=30.0)
    operator.set_mismatch(mass_scale=1.0)
    expected = {"mass_scale": 1.0, "per_link": {"base": 1.1}, "payload_kg": 0.75, "payload_center_m": [0.05, 0.0, 0.0]}
    assert calls[-1] == expected and len(calls) == 3
    chosen = operator.mismatch()
    assert (chosen.mass_scale, dict(chosen.per_link), chosen.payload_kg) == (1.0, {"base": 1.1}, 0.75)
