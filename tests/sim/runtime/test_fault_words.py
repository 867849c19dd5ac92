"""Every fault has words, and says what is known of it."""

from control.faults import Fault
from sim.runtime.fault_words import FAULT_WORDS, describe


def test_every_fault_has_words_and_details_follow_them() -> None:
    assert set(FAULT_WORDS) == set(Fault)
    words = describe(Fault.TILT | Fault.CONTROLLER_ERROR, {Fault.CONTROLLER_ERROR: "mine, ValueError: shapes"})
    assert words["TILT"] == FAULT_WORDS[Fault.TILT]
    assert words["CONTROLLER_ERROR"].endswith("mine, ValueError: shapes")
    assert len(words) == 2
