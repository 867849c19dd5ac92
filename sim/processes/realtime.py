"""Real-time scheduling for a process, and the threads that it starts later, where the system grants it."""

import logging
import os

_log = logging.getLogger(__name__)


def request_realtime(priority: int) -> bool:
    """Ask for SCHED_FIFO at `priority`; False, with a warning, where the system has none or does not permit it."""
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    except (OSError, AttributeError) as error:
        _log.warning("no real-time scheduling (%s); expect missed deadlines on a loaded machine", error)
        return False
    return True
