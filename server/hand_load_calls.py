"""What the operator may say of the hand's load: tare and tool."""

from collections.abc import Sequence

from server.control_client import ControlClient
from server.leadership import Leadership, needs_lease


class HandLoadCalls:
    """Part of Operator."""

    leadership: Leadership
    _client: ControlClient

    @needs_lease
    def tare(self) -> None:
        """Make what the free hand reads its zero."""
        self._client.call("tare")

    @needs_lease
    def clear_tare(self) -> None:
        """Take nothing from the estimates any more."""
        self._client.call("clear_tare")

    @needs_lease
    def set_tool(self, mass_kg: float, center_of_mass_m: Sequence[float]) -> None:
        """Tell controller and estimators what the hand carries."""
        self._client.call("set_tool", mass_kg=mass_kg, center_of_mass_m=list(center_of_mass_m))

    @needs_lease
    def identify_tool(self) -> None:
        """Begin the motion that finds what the hand carries."""
        self._client.call("identify_tool")
