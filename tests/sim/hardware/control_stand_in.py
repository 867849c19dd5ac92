"""Stands in for the control process in test_hardware_process.py: opens the backend, stands up, and holds the stance.

Every line on standard input is a sign of life of the operator. Writes the state's name whenever it changes.
"""

import select
import sys
import time

import numpy as np

from control.joints import DAMPING, NOMINAL_POSITION, STIFFNESS
from control.timing import TICK_S
from control.types import JointCommand
from sim.backends.hardware.backend import HardwareBackend
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.states import DriveState, Request

NEXT = {DriveState.OBSERVE: Request.ENGAGE, DriveState.DAMPED: Request.STAND, DriveState.READY: Request.START}


def main() -> None:
    backend = HardwareBackend(HardwareConfig.from_json(sys.argv[1]))
    backend.open()
    hold = JointCommand(NOMINAL_POSITION, np.zeros(22), STIFFNESS, DAMPING)
    heard = asked = time.monotonic()
    state = None
    while True:
        if select.select([sys.stdin], [], [], 0.0)[0] and sys.stdin.readline():
            heard = time.monotonic()
        backend.operator_silent_s = time.monotonic() - heard
        backend.write(hold)
        status = backend.status()
        if status.state in NEXT and not status.engaging and time.monotonic() - asked > 0.2:
            asked = time.monotonic()
            backend.request(NEXT[status.state])
        if status.state != state:
            state = status.state
            sys.stdout.write(f"{state.name} {backend.io_pid} {status.message}\n")
            sys.stdout.flush()
        time.sleep(TICK_S)


main()
