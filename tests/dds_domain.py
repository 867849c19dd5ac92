"""DDS domains that no other test on this machine uses."""

import itertools
import os
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.records import memory_path

NUMBERS = range(2, 100)
"""Beside the console's own, 1, and below those whose ports any program may be given."""

_next = itertools.cycle(NUMBERS)


@contextmanager
def dds_domain() -> Iterator[int]:
    """Number of a domain that is ours while the context lasts; successive ones differ.

    A bound name in Linux's abstract namespace is the claim: it belongs to the network namespace, as the loopback interface
    does, and ends with its process, however that ends. An I/O process that is left on the domain ends with the context.
    """
    for number in itertools.islice(_next, len(NUMBERS)):
        with socket.socket(socket.AF_UNIX) as claim:
            try:
                claim.bind(f"\0forcelens-test-dds-domain-{number}")
            except OSError:
                continue
            if _has_participants(number):
                continue
            try:
                yield number
            finally:
                _end_io_process(number)
            return
    raise RuntimeError("other test runs use all DDS domains")


def _has_participants(domain: int) -> bool:
    """Whether somebody who claims nothing, such as a console, is there: each participant takes the first two free ports."""
    first = 7410 + 250 * domain
    for port in range(first, first + 10):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:
                probe.bind(("", port))
            except OSError:
                return True
    return False


def _end_io_process(domain: int) -> None:
    """It would wait a minute for another console."""
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with suppress(OSError):
            arguments = path.read_text().split("\0")
            if "sim.backends.hardware.io.process" in arguments:
                config = HardwareConfig.from_json(arguments[arguments.index("--config") + 1])
                if config.base.domain == domain:
                    os.kill(int(path.parent.name), signal.SIGKILL)
                    memory_path(config).unlink(missing_ok=True)
