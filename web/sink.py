"""What the console acts on. The server provides it; every method may be called from any thread."""

import time
from collections.abc import Callable, Coroutine, Mapping, Sequence
from concurrent.futures import Future
from typing import Any, Literal, Protocol, TypeVar
from weakref import WeakKeyDictionary

import viser

from control.command.limits import CommandLimits
from sim.backends.hardware.status import HardwareStatus
from sim.backends.simulation.mismatch import Mismatch


class TaskSink(Protocol):
    """What the robot does by itself."""

    def kinds(self) -> Any:
        """The tasks that there are: a list of {name, scene, description, options}. Returns at once."""
        ...

    def start(self, name: str, options: Mapping[str, float]) -> object:
        """Begin a task. Waits until it is begun."""

    def get(self) -> Any:
        """The task begun last: {name, phase, progress, outcome, reason, metrics, plan_m}. Waits for the answer."""
        ...

    def abort(self) -> object:
        """Abort the task at work. Waits until it backs off."""


class PastSink(Protocol):
    """What was: the last minute of a simulation, and a recording that is shown."""

    def seek(self, time_s: float) -> object:
        """Show a moment of the last minute of a paused simulation. Waits until it is shown."""

    def branch(self, **changes: Any) -> object:
        """Set a paused simulation back to what is shown, with `controller`, `estimator` or `mass_scale` changed. Waits."""

    def replay(self) -> dict[str, Any]:
        """Where the recording that is shown stands: `time_s`, `state`, `speed`, `duration_s`."""
        ...

    def change_replay(self, **changes: Any) -> object:
        """Move about in it, by `time_s`, `state`, `speed`. Waits until it is shown."""


class RecordingsSink(Protocol):
    """Recordings."""

    def start(self, name: str) -> object:
        """Record from now on. Waits until it is under way."""

    def stop(self) -> object:
        """End the recording. Waits until its file is whole."""

    def ids(self) -> list[str]:
        """Recordings that are finished, newest first."""
        ...


class EstimatesSink(Protocol):
    """Estimators that are run over the recording that is shown."""

    @property
    def shown(self) -> str | None:
        """Id of that recording, None while none is shown. Returns at once."""
        ...

    def again(self, estimator: str, gains: tuple[float, float] | None) -> int:
        """Begin to run an estimator over it; the id of its result. Returns at once."""
        ...

    def result(self, recording: str, key: int) -> dict[str, Any]:
        """How far it is, as GET /recordings/{id}/estimates/{estimate_id} answers. Returns at once."""
        ...


class ConsoleSink(Protocol):
    """The operator's actions.

    Every action raises a ValueError or a RuntimeError whose message says what to do when it is refused: a value out of
    range, a latched e-stop, another operator's lease, no control process.
    """

    limits: CommandLimits

    @property
    def tasks(self) -> TaskSink:
        """The tasks."""
        ...

    @property
    def past(self) -> PastSink:
        """What was."""
        ...

    @property
    def estimates(self) -> EstimatesSink:
        """Estimators that are run again."""
        ...

    @property
    def recordings(self) -> RecordingsSink:
        """The recordings."""
        ...

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

    def mismatch(self) -> Mismatch:
        """How the simulated robot differs from its model, as chosen. Returns at once."""
        ...

    def set_mismatch(self, **fields: Any) -> object:
        """Choose fields of `mismatch`; what is left out stays. Waits until it is done."""

    def tare(self) -> object:
        """Make what the free hand reads its zero. Waits until it is done."""

    def clear_tare(self) -> object:
        """Take nothing from the estimates any more. Waits until it is done."""

    def set_tool(self, mass_kg: float, center_of_mass_m: Sequence[float]) -> object:
        """Tell controller and estimators what the hand carries. Waits until it is done."""

    def identify_tool(self) -> object:
        """Begin the motion that finds what the hand carries. Waits until it has begun."""

    def add_wrench(self, **fields: Any) -> int:
        """Push the simulated robot, `fields` as POST /wrenches takes them; its id. Waits until it acts."""
        ...

    def list_wrenches(self) -> "Future[list[dict[str, Any]]]":
        """What acts now, oldest first, as GET /wrenches answers. Returns at once."""
        ...

    def remove_wrench(self, key: int) -> object:
        """End a wrench. Waits until it is done."""

    def set_scene(self, name: str) -> object:
        """Load a scene. Waits until it is done."""

    def set_parameters(self, values: Mapping[str, float]) -> object:
        """Change parameters of the scene. Waits until it is done."""

    def set_run(self, state: Literal["running", "paused"] | None, speed: float | None) -> object:
        """Run or pause, and at which speed; None leaves as it is. Waits until it is done."""

    def set_backend(self, name: str, **options: Any) -> object:
        """Drive the simulation or a robot, or show a recording. Waits until a fresh control process runs."""

    def drive(self, request: str) -> object:
        """Ask a robot's drives for a change of state, by the name of a Request. Waits until it has begun."""

    def hardware_status(self) -> HardwareStatus | None:
        """What a robot's I/O process reports; None in simulation, or when it has died. Returns at once."""
        ...


Event = TypeVar("Event", bound=Any)

REPEAT_AFTER_S = 3.0
_told: WeakKeyDictionary[Any, tuple[str, float]] = WeakKeyDictionary()


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
    """Tell one client that what it asked for was refused; of a pull that is refused sixty times a second, once."""
    if client is None:
        return
    told, told_s = _told.get(client, ("", 0.0))
    if message != told or time.monotonic() - told_s > REPEAT_AFTER_S:
        _told[client] = message, time.monotonic()
        client.add_notification("Refused", message, color="orange", auto_close_seconds=6.0)
