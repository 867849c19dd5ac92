"""`python -m sim.emulator`: an emulated robot on this machine, for the console's hardware backend and the vendor's software.

While it runs it obeys JSON lines on standard input, for example {"freeze": true}, {"nan": "FL_calf"},
{"push": {"force_n": [15, 0, 0], "duration_s": 2}} or {"report": true}; see sim/emulator/orders.py.
"""

import argparse
import json
import logging
import os
import sys
import threading
from collections.abc import Sequence

from control.joints import JOINT_NAMES
from sim.arguments import ARM_PORT, DDS_DOMAIN
from sim.backends.protocol import BackendError
from sim.backends.unitree.dds import DdsConfig, DdsRobotLink
from sim.emulator.arm_controller import ArmPorts
from sim.emulator.base_board import DEFAULT_MODE
from sim.emulator.emulator import Emulator, EmulatorConfig
from sim.emulator.orders import obey
from sim.processes.realtime import request_realtime
from sim.processes.starting import Starting
from sim.scenes import SCENE_NAMES

FIFO_PRIORITY = 25
"""A robot's board is never late because of another program on this machine."""

_log = logging.getLogger("forcelens.emulator")


def parser() -> argparse.ArgumentParser:
    """Arguments of the command."""
    arguments = argparse.ArgumentParser(
        prog="forcelens emulate", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    arguments.add_argument("--domain", type=DDS_DOMAIN, default=1, help="DDS domain (default 1; 0 is the real robot's)")
    arguments.add_argument("--interface", default="lo", help="network interface (default lo)")
    arguments.add_argument("--allow-robot", action="store_true", help="permit domain 0 or an interface other than lo")
    arguments.add_argument("--multicast", action="store_true", help="discover by multicast, as the vendor's software does")
    arguments.add_argument(
        "--arm-port", type=ARM_PORT, default=8071, help="UDP port of z1_ctrl, 1 to 65534; it answers on the next"
    )
    arguments.add_argument("--lockstep", action="store_true", help="step when the command for the last state has arrived")
    arguments.add_argument("--released", action="store_true", help="no motion program owns the motors at the start")
    arguments.add_argument("--duration", type=float, help="seconds to run (default: until interrupted)")
    arguments.add_argument("--seed", type=int, default=0, help="of sensor errors, random faults and the scene's parameters")
    arguments.add_argument("--scene", choices=SCENE_NAMES, default="free", help="that it stands in (default free)")
    arguments.add_argument("--behind", type=float, default=0.0, metavar="M", help="how far behind the simulation's place in it")
    arguments.add_argument("--fault", action="append", default=[], metavar="JSON", help='faults from the start: {"drop": 0.01}')
    return arguments


def run(arguments: Sequence[str] | None, starting: Starting) -> int:
    """Run the emulator; returns the exit status."""
    options = parser().parse_args(arguments)
    logging.basicConfig(level=logging.INFO, format="%(name)s: %(message)s")
    if not options.lockstep:
        request_realtime(FIFO_PRIORITY)  # before the network, whose threads inherit it
    try:
        link = DdsRobotLink(DdsConfig(options.domain, options.interface, options.allow_robot, options.multicast))
        config = EmulatorConfig(
            seed=options.seed,
            scene=options.scene,
            behind_m=options.behind,
            mode="" if options.released else DEFAULT_MODE,
            arm=ArmPorts(options.arm_port, options.arm_port + 1),
        )
        emulator = Emulator(config, link)
        for text in options.fault:
            emulator.faults.update(json.loads(text), JOINT_NAMES)
    except (BackendError, ValueError) as error:
        _log.error("%s", error)
        return 2
    starting.over()
    threading.Thread(target=_read_orders, args=(emulator,), daemon=True).start()
    _log.info("robot on DDS domain %d, interface %s; arm on UDP %d", options.domain, options.interface, options.arm_port)
    try:
        if options.lockstep:
            emulator.run_lockstep(options.duration)
        else:
            emulator.run_realtime(options.duration)
    except KeyboardInterrupt:
        _log.info("interrupted")
    if emulator.faults.kill:
        os._exit(137)
    emulator.close()
    base = emulator.base
    counts = (emulator.steps, base.accepted, base.refused, base.bad_commands, emulator.resends)
    _log.info("%d steps; commands: %d obeyed, %d refused, %d unsound; %d states sent again", *counts)
    return 0


def _read_orders(emulator: Emulator) -> None:
    for line in sys.stdin:
        try:
            obey(emulator, line, _answer)
        except ValueError as error:
            _log.error("%s", error)


def _answer(text: str) -> None:
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
