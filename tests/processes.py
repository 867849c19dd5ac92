"""Processes that tests start: who descends from whom, and who still runs. One that ends meanwhile is simply not there."""

from contextlib import suppress

import psutil


def children(pid: int, *, recursive: bool = False) -> list[psutil.Process]:
    """What a process started (and, recursive, what that started) and what still runs; nothing of a process that is gone."""
    with suppress(psutil.NoSuchProcess):
        return [child for child in psutil.Process(pid).children(recursive=recursive) if runs(child.pid)]
    return []


def tree(pid: int) -> set[int]:
    """A process and all that descend from it; empty when it is gone."""
    return {pid, *(child.pid for child in children(pid, recursive=True))} if runs(pid) else set()


def runs(pid: int) -> bool:
    """Whether it has not ended; a zombie has."""
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    return False


def command_line(process: psutil.Process) -> str:
    """Its command, empty when it is gone."""
    with suppress(psutil.NoSuchProcess, psutil.ZombieProcess):
        return " ".join(process.cmdline())
    return ""
