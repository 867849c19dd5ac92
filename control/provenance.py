"""Provenance of a result: git commit and machine.

It stands in control/ because weights, which control.learning writes, name their commit as well.
"""

import os
import platform
import subprocess

from control.paths import ROOT


def commit() -> str:
    """Short git commit of the working tree, with "+" when it has local changes, or "unknown" outside a checkout."""
    try:
        head = subprocess.run(["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True)
        status = subprocess.run(["git", "status", "--porcelain"], cwd=ROOT, capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return head.stdout.strip() + ("+" if status.stdout.strip() else "")


def machine() -> str:
    """What the numbers were taken on."""
    return f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}"
