"""`python -m sim.emulator`, or `forcelens emulate`; see sim.emulator.command_line."""

import sys
from collections.abc import Sequence

from sim.processes.standard_streams import protect_standard_streams
from sim.processes.starting import Starting


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status. What takes long to import is imported once Ctrl-C is taken care of."""
    starting = Starting("forcelens.emulator: interrupted")
    protect_standard_streams()
    from sim.emulator.command_line import run

    return run(arguments, starting)


if __name__ == "__main__":
    sys.exit(main())
