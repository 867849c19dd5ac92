"""What the console acts on. The server provides it; every method may be called from any thread."""

from collections.abc import Callable, Coroutine
from typing import Any, Literal, Protocol, TypeVar

import viser

from control.command.limits import CommandLimits
from sim.backends.hardware.status import HardwareStatus


class ConsoleSink(Protocol):
    """The operator's actions.

    Every action raises a ValueError or a RuntimeError whose message says what to do when it is refused: a value out of
    range, a latched e-stop, another operator's lease, no control process.
    """

    limits: CommandLimits

    def available(self) -> dict[str, Any]:
        """Names in `controllers`, `estimators`, `scenes`; in `backends` {name, available, reason} with the reason why not."""
        ...

    def patch_command(self, **fields: Any) -> object:
        """Change fields of the command. Returns at once."""

    def set_drag(self, target_in_world: tuple[float, float, float] | None) -> None:
        """Pull the hand towards a point (3,) m in world with a spring; None lets go. Returns at once."""

    def select_controller(self, name: str) -> object:
        """Switch controllers. Waits until it is done."""

    def select_estimator(self, name: str) -> object:
        """Choose whose estimate feeds the controller. Waits until it is done."""

    def set_mismatch(self, mass_scale: float) -> object:
        """Scale the simulated robot's mass. Waits until it is done."""

    def set_scene(self, name: str) -> object:
        """Load a scene. Waits until it is done."""

    def set_run(self, state: Literal["running", "paused"] | None, speed: float | None) -> object:
        """Run or pause, and at which speed; None leaves as it is. Waits until it is done."""

    def seek(self, time_s: float) -> object:
        """Show a moment of the last minute of a paused simulation. Waits until it is shown."""

    def branch(self, **changes: Any) -> object:
        """Set a paused simulation back to what is shown, with `controller`, `estimator` or `mass_scale` changed. Waits."""

    def start_recording(self, name: str) -> object:
        """Record from now on. Waits until it is under way."""

    def stop_recording(self) -> object:
        """End the recording. Waits until its file is whole."""

    def recording_ids(self) -> list[str]:
        """Recordings that are finished, newest first."""
        ...

    def replay(self, **changes: Any) -> dict[str, Any]:
        """Move about in the recording that is shown, by `time_s`, `state`, `speed`. Answers those and `duration_s`."""
        ...

    def set_backend(self, name: str, **options: Any) -> object:
        """Drive the simulation or a robot, or show a recording. Waits until a fresh control process runs."""

    def drive(self, request: str) -> object:
        """Ask a robot's drives for a change of state, by the name of a Request. Waits until it has begun."""

    def hardware_status(self) -> HardwareStatus | None:
        """What a robot's I/O process reports; None in simulation, or when it has died. Returns at once."""
        ...


Event = TypeVar("Event", bound=Any)


def reports_refusal(callback: Callable[[Event], object]) -> Callable[[Event], Coroutine[Any, Any, None]]:
    """Make a Viser callback of a plain function: in order, and with refusals shown to the client that asked.

    Viser keeps the order of `async` callbacks only.
    """

    async def ordered(event: Event) -> None:
        try:
            callback(event)
        except (ValueError, RuntimeError) as refusal:
            notify(event.client, str(refusal))

    return ordered


def notify(client: viser.ClientHandle | None, message: str) -> None:
    """Tell one client that what it asked for was refused."""
    if client is not None:
        client.add_notification("Refused", message, color="orange", auto_close_seconds=6.0)
