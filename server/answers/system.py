"""Schemas of health and of the control process' restart."""

from typing import Literal, NotRequired

from server.answers.schema import Answer
from server.answers.state import Loop


class HealthAnswer(Answer):
    """Whether the control process lives and its backend steps."""

    status: Literal["ok", "busy", "failed", "stalled", "dead"]
    """`ok` also while paused; `busy`: starts or loads a scene; `failed`: its backend steps no more; `stalled`: lives but hangs;
    `dead`: no process"""
    version: str
    """of Forcelens"""
    commit: str
    """git commit of a checkout, with + if files were changed"""
    backend: str | None
    """what the pipeline drives; null before the first snapshot"""
    uptime_s: float
    """s, of the web process"""
    faults: list[str]
    """as in the state"""
    loop: Loop | None
    """how the control loop keeps time; null before the first snapshot"""
    reason: NotRequired[str]
    """why the control process is dead, or why its backend failed"""


class ReadyAnswer(Answer):
    """Whether commands would act now."""

    ready: bool
    """the control process ticks, and its backend too"""
    reason: str | None
    """why not"""


class RestartAnswer(Answer):
    """A fresh control process runs."""

    status: Literal["ok"]
    """it is ready, in a safe hold"""
