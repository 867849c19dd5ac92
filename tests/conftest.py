"""Order of the tests, and what each must leave behind: nothing."""

import asyncio
import os
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from sim.backends.unitree.dds import dds_unavailable_because
from tests.processes import children, command_line

ENDING_S = 10.0


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what cannot run, and keep together, in any order, the tests that share something.

    Shared are fixtures of package scope. In a folder, the users of those named `shared_...` come last, so that what they
    share starts with the first of them and ends with the last.
    """
    why_no_hardware = dds_unavailable_because()
    places: dict[Path, int] = {}
    for item in items:
        for folder in item.path.parents:
            places.setdefault(folder, len(places))
        if why_no_hardware is not None and item.get_closest_marker("hardware"):
            item.add_marker(pytest.mark.skip(reason=why_no_hardware))

    def place(item: pytest.Item) -> tuple[list[int], bool]:
        shares = isinstance(item, pytest.Function) and any(name.startswith("shared_") for name in item.fixturenames)
        return [places[folder] for folder in reversed(item.path.parents)], shares

    items.sort(key=place)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
    """Fail the last test of a folder when a process or an event loop outlives it."""
    yield
    if nextitem is None or nextitem.path.parent != item.path.parent:
        left: list[object] = _lasting_children()
        with suppress(RuntimeError):
            left.append(asyncio.get_running_loop())
        assert not left, f"the tests of {item.path.parent} leave behind: {left}"


def _lasting_children() -> list[object]:
    """Children of this process that do not end within a moment, with their commands."""
    deadline = time.monotonic() + ENDING_S
    while (left := _children()) and time.monotonic() < deadline:
        time.sleep(0.05)
    return left


def _children() -> list[object]:
    """Living children of this process but the one that Python keeps for itself."""
    commands = {child.pid: command_line(child) for child in children(os.getpid())}
    return [f"{pid}: {line}" for pid, line in commands.items() if line and "multiprocessing.resource_tracker" not in line]
