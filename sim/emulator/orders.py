"""What an emulator is told while it runs, one JSON object per line.

{"freeze": true}                                            faults by name: see sim.emulator.faults
{"push": {"force_n": [15, 0, 0], "duration_s": 2}}          a wrench on the hand: fields of wrenches.Pulse
{"lead": {"seed": 1, "duration_s": 60}}                     somebody leads the hand: fields of LeadingPerson
{"report": true}                                            answered by one line: see `report`
"""

import json
import math
from collections.abc import Callable
from typing import Any

from control.joints import JOINT_NAMES
from sim.backends.simulation.leading_person import LeadingPerson
from sim.backends.simulation.wrenches import Pulse, WrenchSource
from sim.emulator.emulator import Emulator

_SOURCES: dict[str, Callable[..., Pulse | WrenchSource]] = {"push": Pulse, "lead": LeadingPerson}


def obey(emulator: Emulator, line: str, answer: Callable[[str], None]) -> None:
    """Carry out one line; `answer` is called between two steps.

    Raises:
        ValueError: the line is no such order; the message names what is wrong.
    """
    order = json.loads(line)
    if not isinstance(order, dict):
        raise ValueError("an order must be a JSON object")
    source = next((name for name in _SOURCES if name in order), None)
    if source is not None:
        try:
            wrench = _SOURCES[source](**order[source])
        except TypeError as error:
            raise ValueError(f"{source}: {error}") from error
        emulator.between_steps(lambda: emulator.body.backend.wrenches.add(wrench))
    elif "report" in order:
        emulator.between_steps(lambda: answer(json.dumps(report(emulator))))
    else:
        emulator.faults.update(order, JOINT_NAMES)


def report(emulator: Emulator) -> dict[str, Any]:
    """What the robot does and what its motors were told in the last step."""
    truth, command = emulator.body.backend.truth(), emulator.command
    heading = truth.rotation_heading_to_world
    return {
        "time_s": emulator.body.time_s,
        "base_position_m": truth.base_position.tolist(),
        "base_yaw_rad": math.atan2(heading[1, 0], heading[0, 0]),
        "hand_force_n": truth.force_true_n.tolist(),
        "readings": emulator.body.readings,
        "motion_program": emulator.base.mode,
        "frames_obeyed": emulator.base.accepted,
        "stiffness_max": float(command.stiffness.max()),
        "damping_min": float(command.damping.min()),
    }
