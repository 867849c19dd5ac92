"""The vendor's remote procedure calls: who answers what on `rt/api/<service>/request` and `/response`."""

from dataclasses import dataclass
from enum import IntEnum

MOTION_SWITCHER = "motion_switcher"
SPORT = "sport"
SERVICES = (MOTION_SWITCHER, SPORT)


class MotionSwitcherApi(IntEnum):
    """Which program owns the motors. CHECK_MODE answers JSON {"form", "name"}; an empty name means none."""

    CHECK_MODE = 1001
    SELECT_MODE = 1002
    RELEASE_MODE = 1003


class SportApi(IntEnum):
    """The part of the sport service that matters before its release."""

    DAMP = 1001
    STAND_UP = 1004
    STAND_DOWN = 1005


@dataclass(frozen=True, slots=True)
class RpcRequest:
    """One call. `id` is chosen by the caller; every client sees every response and picks its own by it."""

    service: str
    id: int
    api_id: int
    parameter: str = "{}"


@dataclass(frozen=True, slots=True)
class RpcResponse:
    """The answer to the request of the same id; code 0 is success, `data` is JSON or empty."""

    service: str
    id: int
    api_id: int
    code: int
    data: str = ""
