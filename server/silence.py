"""Whether the newest snapshot still says what is: a control process that has died or hangs publishes no other."""

from typing import NamedTuple

from server.control_client import STALLED_AFTER_S, ControlClient
from sim.runtime.fault_words import CONTROL_PROCESS_DEAD, CONTROL_PROCESS_SILENT


class Silence(NamedTuple):
    """For how long nothing newer has come, s, zero while all is well, and the fault that this is; None while it is busy."""

    stale_s: float
    fault: str | None


NO_SILENCE = Silence(0.0, None)


def silence_of(client: ControlClient) -> Silence:
    """The silence of a control process, to a tenth of a second."""
    age_s = round(client.snapshot_age_s(), 1)
    if not client.alive:
        return Silence(age_s, CONTROL_PROCESS_DEAD)
    if age_s < STALLED_AFTER_S:
        return NO_SILENCE
    return Silence(age_s, CONTROL_PROCESS_SILENT if client.stalled else None)
