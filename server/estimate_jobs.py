"""Estimators run over recordings on demand, each in a process of its own: `python -m sim.reestimate`."""

import itertools
import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from control.estimation.registry import LEARNED_NAMES, MODEL_BASED_NAMES
from server.errors import InvalidFieldError, MissingError, RefusedError

MOST_RUNNING = 1
"""The control process needs the other core."""

MOST_KEPT = 16
_NAMES = (*MODEL_BASED_NAMES, *LEARNED_NAMES)
_NUMBERS = ("difference_rms_n", "error_rms_n", "error_then_rms_n", "real_time_factor")
_SERIES = ("time_s", "force_n", "force_then_n")


@dataclass(slots=True)
class _Job:
    recording: str
    estimator: str
    gains: tuple[float, float] | None
    folder: tempfile.TemporaryDirectory[str]
    process: subprocess.Popen[str]


class EstimateJobs:
    """Any thread may call. The results of the last MOST_KEPT are kept while the console runs.

    Args:
        shown: file of the recording that the console shows, None while it shows none.
    """

    def __init__(self, shown: Callable[[], Path | None]) -> None:
        self._shown = shown
        self._jobs: dict[int, _Job] = {}
        self._ids = itertools.count(1)
        self._lock = threading.Lock()

    @property
    def shown(self) -> str | None:
        """Id of the recording that is shown."""
        path = self._shown()
        return None if path is None else path.stem

    def again(self, estimator: str, gains: tuple[float, float] | None) -> int:
        """Like `start`, over the recording that is shown."""
        path = self._shown()
        if path is None:
            raise RefusedError("no recording is shown; PUT /api/v1/backend with 'replay' and its id first")
        return self.start(path.stem, path, estimator, gains)

    def start(self, recording: str, path: Path, estimator: str, gains: tuple[float, float] | None) -> int:
        """Run an estimator over the recording at `path`; the id of its result.

        Raises:
            InvalidFieldError: no estimator has this name.
            RefusedError: another one runs.
        """
        if estimator not in _NAMES:
            raise InvalidFieldError("estimator", f"{estimator!r} does not exist", ", ".join(_NAMES))
        with self._lock:
            if sum(job.process.poll() is None for job in self._jobs.values()) >= MOST_RUNNING:
                raise RefusedError("an estimator runs over a recording already; wait for its result")
            folder = tempfile.TemporaryDirectory(prefix="forcelens-")
            words = ["nice", sys.executable, "-m", "sim.reestimate", str(path), "--estimator", estimator]
            words += ["--json", str(Path(folder.name) / "result.json")]
            if gains is not None:
                words += ["--gains", *map(repr, gains)]
            process = subprocess.Popen(
                words, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
            )
            key = next(self._ids)
            self._jobs[key] = _Job(recording, estimator, gains, folder, process)
            while len(self._jobs) > MOST_KEPT:
                self._jobs.pop(next(iter(self._jobs))).folder.cleanup()
            return key

    def result(self, recording: str, key: int) -> dict[str, Any]:
        """Fields of server.answers.recordings.EstimatesAnswer.

        Raises:
            MissingError: there is none of that id of that recording.
        """
        job = self._jobs.get(key)
        if job is None or job.recording != recording:
            raise MissingError(f"there are no estimates {key} of recording {recording!r}")
        gains = None if job.gains is None else {"k1": job.gains[0], "k2": job.gains[1]}
        answer: dict[str, Any] = {"id": key, "state": "running", "estimator": job.estimator, "gains": gains, "message": None}
        answer |= dict.fromkeys(_NUMBERS) | {name: [] for name in _SERIES}
        if job.process.poll() is None:
            return answer
        if job.process.returncode != 0:
            said = "" if job.process.stderr is None or job.process.stderr.closed else job.process.stderr.read().strip()
            return {**answer, "state": "failed", "message": said.splitlines()[-1] if said else "it was ended"}
        content = json.loads((Path(job.folder.name) / "result.json").read_text(encoding="utf-8"))
        return {**answer, "state": "done", **{name: content.get(name) for name in (*_NUMBERS, *_SERIES)}}

    def close(self) -> None:
        """End what runs."""
        for job in self._jobs.values():
            if job.process.poll() is None:
                job.process.kill()
                job.process.wait()
            job.folder.cleanup()
        self._jobs.clear()
