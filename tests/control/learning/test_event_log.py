"""Live curves: readable event files with TensorBoard, and training goes on without it."""

import logging
import sys
from pathlib import Path

import pytest

from control.learning.policy.event_log import EventLog


def test_without_tensorboard_it_says_so_and_writes_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    for name in [name for name in sys.modules if name.startswith("torch.utils.tensorboard")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "tensorboard", None)
    with caplog.at_level(logging.INFO):
        log = EventLog(tmp_path)
    log.add(1, {"reward/locomotion": 0.5})
    assert not log.active
    assert "TensorBoard is not installed" in caplog.text
    assert not list(tmp_path.iterdir())


def test_curves_come_back_and_a_resumed_run_replaces_what_it_repeats(tmp_path: Path):
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import (  # pyright: ignore[reportMissingImports]
        EventAccumulator,
    )

    for value, start in ((1.0, 0), (2.0, 2)):
        log = EventLog(tmp_path, start)
        for step in range(start, 4):
            log.add(step, {"score/total": value})
    curves = EventAccumulator(str(tmp_path))
    curves.Reload()
    assert [(event.step, event.value) for event in curves.Scalars("score/total")] == [(0, 1.0), (1, 1.0), (2, 2.0), (3, 2.0)]
