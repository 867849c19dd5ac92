"""What was, for REST and for the page: the last minute of a simulation, and a recording that is shown."""

from collections.abc import Callable
from typing import Any

from server.control_client import SLOW_CALL_TIMEOUT_S, ControlClient
from server.leadership import Leadership, needs_lease
from server.schemas import BranchRequest, ReplayRequest, SeekRequest
from server.selection import Selection
from server.validation import validated
from sim.backends.simulation.mismatch import Mismatch


class PastHandle:
    """Shows what was, and goes on from it.

    Args:
        client: handle on the control process.
        leadership: who may change something; to look at a moment is anyone's.
        require_choice: raises InvalidFieldError where a kind (such as "controllers") has no such name, given for a field.
        selected: told what is selected after a branch.
    """

    def __init__(
        self,
        client: ControlClient,
        leadership: Leadership,
        require_choice: Callable[[str, str, str], None],
        selected: Callable[[Selection], None],
    ) -> None:
        self.leadership = leadership
        self._client = client
        self._require_choice = require_choice
        self._selected = selected

    def history(self) -> dict[str, Any]:
        """Fields of server.answers.history.HistoryAnswer. Raises RefusedError on hardware."""
        return self._client.call("history")

    def seek(self, time_s: float) -> dict[str, Any]:
        """Show a moment of the last minute; answers like `history`.

        Raises:
            InvalidFieldError: the history does not reach it.
            RefusedError: the simulation runs, or nothing is kept.
        """
        return self._client.call("seek", **validated(SeekRequest, {"time_s": time_s}))

    @needs_lease
    def branch(self, **changes: Any) -> dict[str, Any]:
        """Go on from a moment of the last minute; `changes` are fields of BranchRequest. Answers BranchAnswer.

        Raises:
            InvalidFieldError, RefusedError: like `seek`, or a name that does not exist.
        """
        request = validated(BranchRequest, changes)
        for field in ("controller", "estimator"):
            if field in request:
                self._require_choice(f"{field}s", request[field], field)
        if "gains" in request:
            request["gains"] = (request["gains"]["k1"], request["gains"]["k2"])
        answer = self._client.call("branch", SLOW_CALL_TIMEOUT_S, **request)
        gains = answer["gains"]
        x, y, z = answer["payload_center_m"]
        mismatch = Mismatch(
            answer["mass_scale"], answer["per_link"], payload_kg=answer["payload_kg"], payload_center_m=(x, y, z)
        )
        self._selected(Selection(gains, mismatch))
        return {**answer, "gains": None if gains is None else {"k1": gains[0], "k2": gains[1]}}

    def replay(self) -> dict[str, Any]:
        """Where a recording that is shown stands: fields of server.answers.replay.ReplayAnswer.

        Raises:
            RefusedError: no recording is shown.
        """
        return self._client.call("replay")

    @needs_lease
    def change_replay(self, **changes: Any) -> dict[str, Any]:
        """Show a recording from elsewhere, or otherwise; `changes` are fields of ReplayRequest. Answers like `replay`.

        Raises:
            InvalidFieldError: the recording does not reach that time.
            RefusedError: no recording is shown.
        """
        return self._client.call("replay", **validated(ReplayRequest, changes))
