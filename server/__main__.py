"""`forcelens`, or `python -m server`: start the console and print where it is. `forcelens emulate` runs an emulated robot,
`forcelens record` has a running console record."""

import os
import sys

from sim.processes.heap import return_freed_memory
from sim.processes.standard_streams import protect_standard_streams
from sim.processes.starting import Starting


def main() -> int:
    """Run the command; returns the exit status. What takes long to import is imported once Ctrl-C is taken care of."""
    # MuJoCo would look for a window library in processes of its own, which a Ctrl-C makes complain. We open no window.
    os.environ.setdefault("MUJOCO_GL", "disable")
    if sys.argv[1:2] == ["emulate"]:
        from sim.emulator.__main__ import main as emulate

        return emulate(sys.argv[2:])
    if sys.argv[1:2] == ["record"]:
        from server.record_command import record

        return record(sys.argv[2:])
    starting = Starting("Forcelens has stopped")
    protect_standard_streams()
    return_freed_memory()
    from server.command_line import run

    return run(sys.argv[1:], starting)


if __name__ == "__main__":
    sys.exit(main())
