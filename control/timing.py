"""The tempo of everything: the tick, the control period, and the job of each tick of a control period.

A control period has SLOT_COUNT ticks. Ticks are numbered from the pipeline's last reset; slot k holds the ticks whose number
is k modulo SLOT_COUNT. A job that takes a large part of a tick has a slot to itself, so that no tick is much longer than the
others; cheap jobs share.
"""

from collections.abc import Mapping, Sequence
from enum import Enum, auto

TICK_S = 0.002
"""Sensors, observers, safety gate and drives run at 500 Hz."""

CONTROL_PERIOD_S = 0.02
"""Controllers, references and networks run at 50 Hz."""

SLOT_COUNT = round(CONTROL_PERIOD_S / TICK_S)


class Job(Enum):
    """What is done at some ticks of a control period only.

    CONTROLLER: new joint targets.
    REFERENCES: guidance, limits and filter of the command; one tick before the controller, which needs them.
    SHOWN_ESTIMATE: the estimate of one estimator that does not feed the controller.
    ADAPTATION: masses and frictions of the adaptive estimator.
    NETWORK_STEP: the network of the estimator that feeds the controller.
    SNAPSHOT: what consoles and scripts see.
    LIVE_ERRORS: of the estimators against the truth, which the snapshot of the same tick needs anyway.
    KEPT_MOMENT: what a simulation carries, truth included, for its history; not at every period.
    """

    CONTROLLER = auto()
    REFERENCES = auto()
    SHOWN_ESTIMATE = auto()
    ADAPTATION = auto()
    NETWORK_STEP = auto()
    SNAPSHOT = auto()
    LIVE_ERRORS = auto()
    KEPT_MOMENT = auto()


TIMETABLE: tuple[tuple[Job, ...], ...] = (
    (Job.CONTROLLER,),
    (Job.SHOWN_ESTIMATE,),
    (Job.SHOWN_ESTIMATE, Job.SNAPSHOT, Job.LIVE_ERRORS),
    (Job.SHOWN_ESTIMATE,),
    (Job.SHOWN_ESTIMATE,),
    (Job.ADAPTATION,),
    (Job.SHOWN_ESTIMATE,),
    (Job.SHOWN_ESTIMATE, Job.SNAPSHOT, Job.KEPT_MOMENT),
    (Job.NETWORK_STEP,),
    (Job.REFERENCES,),
)
"""The jobs of each slot. Where snapshots are filled none of the default estimators is shown: gmo_cqp is shown with
hybrid_paper, and hybrid is selected."""

CHEAP_JOBS = frozenset({Job.SNAPSHOT, Job.LIVE_ERRORS, Job.KEPT_MOMENT})
"""Jobs that may share a slot. All others have one to themselves."""


class TimetableError(ValueError):
    """There are more estimators than MOST_ESTIMATORS."""


def slots(job: Job) -> tuple[int, ...]:
    """Slots in which a job runs, ascending."""
    return tuple(slot for slot, jobs in enumerate(TIMETABLE) if job in jobs)


MOST_ESTIMATORS = len(slots(Job.SHOWN_ESTIMATE)) + 1
"""One feeds the controller at every tick, the others are shown."""


def shown_slots(names: Sequence[str], selected: str, bases: Mapping[str, str] | None = None) -> dict[str, int]:
    """Slot in which each of the estimators `names` is shown, but for the one that is `selected` to feed the controller.

    Each of the first has a slot of its own. One more takes over that of the selected estimator, which estimates at every tick
    and steps its network in the slot of NETWORK_STEP. An estimator from whose estimate another one makes its own is shown
    with that one, which needs it then anyway.

    Args:
        names: of all estimators.
        selected: one of them.
        bases: the estimator from whose estimate another one makes its own, by the name of the other one.

    Raises:
        TimetableError: two estimators would share a slot.
    """
    own = slots(Job.SHOWN_ESTIMATE)
    if len(names) > MOST_ESTIMATORS:
        raise TimetableError(f"there are slots for {MOST_ESTIMATORS} estimators, not for {', '.join(names)}; leave some out")
    shown = dict(zip(names, own, strict=False))
    freed = shown.pop(selected, None)
    if len(names) > len(own) and freed is not None:
        shown[names[-1]] = freed
    for name, base in (bases or {}).items():
        if name in shown and base in shown:
            shown[base] = shown[name]
    return shown


def due(job: Job, tick: int) -> bool:
    """Whether a job runs at the tick of this number."""
    return job in TIMETABLE[tick % SLOT_COUNT]
