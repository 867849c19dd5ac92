"""Takes the motors from the robot's own motion program before the first command, as the vendor's examples do.

Two programs commanding the same motors fight each other with full torque. So: lie down, release, and ask until the
motion switcher names no owner. Nothing is published on `rt/lowcmd` before that.
"""

import itertools
import json
import random

from sim.backends.unitree.link import BaseLink
from sim.backends.unitree.rpc import MOTION_SWITCHER, SPORT, MotionSwitcherApi, RpcRequest, RpcResponse, SportApi


class ModeRelease:
    """One release, advanced by `step` from the I/O loop; it never blocks.

    Attributes:
        done: the motion switcher has said that nobody owns the motors.
        failure: why it will not succeed, or None.
    """

    ASK_EVERY_S = 1.0
    LIE_DOWN_S = 3.0

    def __init__(self, link: BaseLink, now: float, timeout_s: float) -> None:
        self._link = link
        self._deadline_s = now + timeout_s
        self._timeout_s = timeout_s
        self._next_s = now
        # Responses go to every client; a random start keeps ours apart from those of other programs.
        self._ids = itertools.count(random.getrandbits(40))
        self._pending: set[int] = set()
        self._lay_down_s: float | None = None
        self._state = "nobody answers"
        self.done = False
        self.failure: str | None = None

    def step(self, now: float) -> None:
        """Read answers and ask again when it is time."""
        if self.done or self.failure is not None:
            return
        for response in self._link.responses():
            if response.id in self._pending:
                self._pending.discard(response.id)
                self._take(response, now)
        if self.done:
            return
        if now >= self._deadline_s:
            self.failure = f"the robot's motion program was not released within {self._timeout_s:.0f} s: {self._state}"
        elif now >= self._next_s:
            self._next_s = now + self.ASK_EVERY_S
            self._call(MOTION_SWITCHER, MotionSwitcherApi.CHECK_MODE)

    def _take(self, response: RpcResponse, now: float) -> None:
        if response.service != MOTION_SWITCHER or response.api_id != MotionSwitcherApi.CHECK_MODE:
            return
        if response.code != 0:
            self._state = f"the motion switcher answers with error {response.code}"
            return
        try:
            owner = json.loads(response.data)["name"]
        except (json.JSONDecodeError, KeyError, TypeError):
            owner = None
        if not isinstance(owner, str):
            self.failure = f"the motion switcher answered {response.data!r}, which names no owner"
            return
        self._state = f"{owner!r} still owns the motors"
        if not owner:
            self.done = True
        elif self._lay_down_s is None:
            self._lay_down_s = now
            self._call(SPORT, SportApi.STAND_DOWN)
        elif now - self._lay_down_s >= self.LIE_DOWN_S:
            self._call(MOTION_SWITCHER, MotionSwitcherApi.RELEASE_MODE)

    def _call(self, service: str, api: MotionSwitcherApi | SportApi) -> None:
        request = RpcRequest(service, next(self._ids), int(api))
        self._pending.add(request.id)
        self._link.request(request)
