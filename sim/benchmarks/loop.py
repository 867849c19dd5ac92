"""How fast a tick is, and how well the server keeps time: `python -m sim.benchmarks.loop`.

The headless part steps a session in this process, in turn with what a tick cannot do without; the other part starts a real
server and talks to it as browsers do. Deadlines and processor shares are meaningful on an otherwise quiet machine only.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from sim.benchmarks.loop_headless import headless, plot
from sim.benchmarks.loop_served import served
from sim.benchmarks.loop_stages import stages
from sim.benchmarks.report import Report, argument_parser

SLOW_MJ_STEP_US = 40.0
"""Median of the bare mj_step above which a machine counts as slow."""


def main() -> None:
    """Run the benchmark."""
    parser = argument_parser(__doc__ or "")
    parser.add_argument("--stages", action="store_true", help="only what each job of the timetable and each stage costs")
    arguments = parser.parse_args()
    report = Report("loop", arguments.seed)
    if arguments.stages:
        report.progress("stages of a tick")
        stages(report, 500 if arguments.quick else 5000)
        report.finish(arguments.json)
        return
    report.progress("headless ticks")
    durations = headless(report, 500 if arguments.quick else 5000)
    if arguments.plot is not None:
        plot(arguments.plot, durations)
    report.progress("server")
    slow_machine = float(np.median(durations.physics)) > SLOW_MJ_STEP_US
    served(report, 6.0 if arguments.quick else 60.0, 20 if arguments.quick else 300, slow_machine)
    report.finish(arguments.json)


if __name__ == "__main__":
    main()
