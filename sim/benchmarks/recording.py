"""What recording and history cost, and what they hold: `python -m sim.benchmarks.recording`, a quarter of an hour.

Shares are measured in turn within one run. Processor shares and the recorder's losses are meaningful on a quiet machine only.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import tempfile
from pathlib import Path

from sim.benchmarks.report import Report, argument_parser


def main() -> None:
    """Run the benchmark."""
    # The recorder that is spawned imports this file, and shall not hold what it has no use for.
    from sim.benchmarks.recording_files import files, kills
    from sim.benchmarks.recording_served import deadlines
    from sim.benchmarks.recording_ticks import again, history, recorder, ticks

    arguments = argument_parser(__doc__ or "").parse_args()
    quick: bool = arguments.quick
    report = Report("recording", arguments.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        report.progress("cost of a tick, in turn")
        ticks(report, 6 if quick else 80)
        report.progress("history")
        history(report, 3.0 if quick else 60.0)
        report.progress("recorder at the robot's own pace")
        path = recorder(report, folder, 3.0 if quick else 60.0)
        report.progress("deadlines of a console, in turn")
        deadlines(report, folder / "console", 1 if quick else 10, 3.0 if quick else 30.0)
        report.progress("the pipeline again")
        again(report, path)
        report.progress("killed recorders")
        kills(report, folder, 2 if quick else 50)
        report.progress("a long file")
        files(report, folder, 0.2 if quick else 10.0)
    report.finish(arguments.json)


if __name__ == "__main__":
    main()
