"""The operator's actions, for REST and for the 3-D scene alike: one path, so that one set of checks holds for both.

Every method may be called from any thread. A refusal is a RuntimeError or ValueError whose message says what to do.
"""

import contextlib
import logging
import threading
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import Future
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from control.command.limits import DEFAULT_COMMAND, CommandError, CommandLimits, clip_command
from control.types import Command
from server.backend_choice import BackendChoice, with_options
from server.control_client import SLOW_CALL_TIMEOUT_S, ControlClient
from server.control_process import ControlLaunch
from server.errors import ControlDeadError, ControlTimeoutError, InvalidFieldError, RefusedError
from server.estimate_jobs import EstimateJobs
from server.hand_load_calls import HandLoadCalls
from server.leadership import Leadership, needs_lease
from server.past_handle import PastHandle
from server.recording_desk import RecordingDesk
from server.robot_handle import RobotHandle
from server.scene_parameters import require_parameters
from server.schemas import BackendRequest, CommandPatch, MismatchRequest, RunRequest, StepRequest, WrenchRequest
from server.selection import Selection
from server.task_handle import TaskHandle
from server.validation import validated
from sim.backends.hardware.backend import unavailable_because
from sim.backends.hardware.config import HardwareConfig
from sim.backends.hardware.states import ACTIVE
from sim.backends.hardware.status import HardwareStatus
from sim.backends.simulation.mismatch import Mismatch
from sim.recording.folder import RecordingFolder, default_folder
from sim.runtime.fault_words import ESTOP_LATCHED
from sim.runtime.snapshot import COMMAND, Mode, command_from_record, command_to_record, on_hardware
from sim.scenes import SCENE_NAMES, draw

_log = logging.getLogger(__name__)

Choices = dict[str, Any]


class Operator(HandLoadCalls):
    """Acts on one control process. Whatever changes something needs the lease, but the e-stop, which is anyone's.

    Args:
        client: handle on the control process.
        launch: what the control process was started with; it drives the simulation.
        hardware: the robot that `set_backend` means when nothing else is said.
        recordings: where they go, by default into the user's data folder.

    Attributes:
        past: what was, shown and gone on from.
        recordings: starts, stops and lists them.
        estimates: of estimators that are run over recordings.
    """

    def __init__(
        self,
        client: ControlClient,
        launch: ControlLaunch,
        hardware: HardwareConfig | None = None,
        recordings: RecordingFolder | None = None,
    ) -> None:
        self.limits: CommandLimits = launch.session.pipeline.limits
        self.selection = Selection()
        self.started_s = time.monotonic()
        self._client = client
        self._launch = launch
        self._hardware = hardware or HardwareConfig()
        self.robot = RobotHandle(client)
        self.leadership = Leadership(self._stop_base)
        self.tasks = TaskHandle(client, self.leadership, lambda: self.command()[1])
        self.past = PastHandle(client, self.leadership, self._require_choice, self._note_selection)
        self.recordings = RecordingDesk(client, self.leadership, recordings or RecordingFolder(default_folder()))
        self.estimates = EstimateJobs(lambda: self.robot.choice.recording)
        self._switching = threading.Lock()
        self._lock = threading.RLock()
        self._command = clip_command(DEFAULT_COMMAND, self.limits)
        self._sequence = 0
        self._hold()

    @property
    def client(self) -> ControlClient:
        """Handle on the control process, for reading."""
        return self._client

    def available(self) -> Choices:
        """Lists `controllers`, `estimators`, `scenes`, `keyframes` (both empty on a robot), `backends` (and why not)."""
        return self._client.wait_ready()

    def heartbeat(self) -> None:
        """Tell the control process that the operator's side lives; call it often."""
        self._notice_absence()
        self.leadership.settle()
        self._client.write_setpoint()

    def _notice_absence(self) -> None:
        """What has stopped because this process was held up, base and drag, stays stopped until somebody asks again."""
        with self._lock:
            absent_s = self._client.unheard_s()
            if absent_s <= self._launch.session.pipeline.safety.setpoint_timeout_s:
                return
            if self._command.base_velocity.any():
                _log.warning("the web process was held up for %.1f s; the base stays stopped until it is asked again", absent_s)
            self._stop_base()

    def _stop_base(self) -> None:
        """Base and drag stand still until somebody asks again; the hand holds what it was asked for."""
        with self._lock:
            if self._command.base_velocity.any():
                self._command = replace(self._command, base_velocity=np.zeros(3))
                self._sequence += 1
                self._send()
            self._client.write_setpoint(drag_active=False)

    def command(self) -> tuple[Command, int]:
        """The command as asked, within limits, and its sequence number."""
        with self._lock:
            return self._command, self._sequence

    @needs_lease
    def patch_command(self, **fields: Any) -> tuple[Command, int]:
        """Ask for other values of the given fields of the command; answers like `command`.

        Raises:
            InvalidFieldError: names the field and its range; nothing changes.
            RefusedError: the e-stop is latched.
            ControlDeadError: no control process runs.
        """
        self._notice_absence()
        patch = validated(CommandPatch, {name: _plain(value) for name, value in fields.items()})
        self._client.require_alive()
        if self._latched():
            raise RefusedError(ESTOP_LATCHED)
        if self.robot.choice.recording is not None:
            raise RefusedError("a recording is shown, which obeys nobody; PUT /api/v1/backend with 'simulation' first")
        changes = {name: np.array(value, dtype=float) if name != "guidance" else value for name, value in patch.items()}
        with self._lock:
            if not changes:
                return self._command, self._sequence
            try:
                self._command = clip_command(replace(self._held_command(), **changes), self.limits)
            except CommandError as error:
                raise InvalidFieldError(error.field, str(error), "see the message") from None
            self._sequence += 1
            self._send()
            return self._command, self._sequence

    def set_drag(self, target_in_world: tuple[float, float, float] | None) -> None:
        """Pull the hand towards a point, or let go with None.

        Raises:
            InvalidFieldError: a target that is not three finite numbers.
            RefusedError: the hand is a robot's own, or another holds the lease.
        """
        if target_in_world is None:
            self._client.write_setpoint(drag_active=False)
        else:
            self._pull(target_in_world)

    @needs_lease
    def _pull(self, target_in_world: tuple[float, float, float]) -> None:
        if self.robot.choice.hardware is not None:
            raise RefusedError("the ball pulls a simulated hand only; pull the robot's own")
        self._notice_absence()
        target = np.asarray(target_in_world, dtype=float)
        if target.shape != (3,) or not np.isfinite(target).all():
            raise InvalidFieldError("target_in_world", "is not a point", "3 finite numbers, m")
        self._client.write_setpoint(drag_active=True, drag_target_in_world=target)

    @needs_lease
    def select_controller(self, name: str) -> None:
        """Choose the controller."""
        self._require_choice("controllers", name)
        self._client.call("select_controller", SLOW_CALL_TIMEOUT_S, name=name)

    @needs_lease
    def select_estimator(self, name: str, gains: tuple[float, float] | None = None) -> None:
        """Choose the estimator, optionally with new observer gains (K1, K2)."""
        self._require_choice("estimators", name)
        if gains is None:
            self._client.call("select_estimator", name=name)
            return
        self._client.call("select_estimator", name=name, k1=gains[0], k2=gains[1])
        self.selection = replace(self.selection, gains=gains)

    def mismatch(self) -> Mismatch:
        """Masses of the simulated robot and load of its hand as last asked for."""
        return self.selection.mismatch

    @needs_lease
    def set_mismatch(self, **fields: Any) -> None:
        """Scale the masses of the simulated robot and load its hand.

        Args:
            fields: of MismatchRequest; what is left out stays as it was last asked for.
        """
        chosen = self.selection.mismatch
        now = {
            "mass_scale": chosen.mass_scale,
            "per_link": dict(chosen.per_link),
            "payload_kg": chosen.payload_kg,
            "payload_center_m": list(chosen.payload_center_m),
        }
        request = validated(MismatchRequest, now | fields)
        self._client.call("set_mismatch", SLOW_CALL_TIMEOUT_S, **request)
        x, y, z = request.pop("payload_center_m")
        self.selection = replace(self.selection, mismatch=replace(chosen, **request, payload_center_m=(x, y, z)))

    @needs_lease
    def add_wrench(self, **fields: Any) -> int:
        """Push the simulated robot, in addition to what acts already; `fields` as WrenchRequest. Its id."""
        return self._client.call("add_wrench", **validated(WrenchRequest, fields))

    def list_wrenches(self) -> "Future[list[dict[str, Any]]]":
        """What acts now, oldest first. Does not wait."""
        return self._client.submit("list_wrenches")

    @needs_lease
    def remove_wrench(self, key: int) -> None:
        """End a wrench.

        Raises:
            MissingError: it is not at work.
        """
        self._client.call("remove_wrench", key=key)

    @needs_lease
    def set_backend(self, name: str, **options: Any) -> None:
        """Drive the simulation or a robot, with a fresh control process; `options` as BackendChoice.options.

        Raises:
            InvalidFieldError: an option that is not allowed.
            RefusedError: a real robot is meant that the command line did not permit, hardware is not available or does not
                answer (then the simulation runs), the robot is not at rest in damping, or another change is under way.
        """
        request = validated(BackendRequest, {"name": name, "options": options})
        choice = BackendChoice()
        if name == "hardware":
            if request["options"].get("allow_robot") and not self._hardware.base.allow_robot:
                raise RefusedError("a real robot is not permitted; whoever starts the console permits it with --allow-robot")
            choice = BackendChoice(with_options(self._hardware, request["options"]))
            reason = unavailable_because()
            if reason is not None:
                raise RefusedError(f"backend 'hardware' is not available: {reason}")
        elif name == "replay":
            if "recording" not in request["options"]:
                raise InvalidFieldError(
                    "options.recording", "is missing", "an id of GET /api/v1/recordings; the tab Time of the page lists them"
                )
            choice = BackendChoice(recording=self.recordings.file(request["options"]["recording"]))
        with self._switch():
            if choice == self.robot.choice and self._client.alive:
                return
            status = self.robot.status()
            if status is not None and status.state in ACTIVE:
                raise RefusedError(f"the robot's drives are {status.state.name}; sit or damp it first")
            try:
                self._start(choice, paused=False)
            except (ControlDeadError, ControlTimeoutError) as error:
                if choice == BackendChoice():
                    raise
                reason = self._client.death or str(error)
                self._start(BackendChoice(), paused=False)
                raise RefusedError(f"backend {name!r} cannot be used: {reason}. The simulation runs instead") from None

    @needs_lease
    def drive(self, request: str) -> HardwareStatus:
        """See RobotHandle."""
        return self.robot.drive(request)

    def hardware_status(self) -> HardwareStatus | None:
        """See RobotHandle."""
        return self.robot.status()

    @needs_lease
    def set_scene(
        self, name: str, parameters: Mapping[str, float] | None = None, *, seed: int | None = None, rigid: bool = False
    ) -> None:
        """Load a scene with the robot at its start and the command at its default.

        Args:
            name: of the scene.
            parameters: of it, those that are not at their defaults.
            seed: draws the parameters that are not given.
            rigid: without padding on what the hand touches.
        """
        self._require_choice("scenes", name)
        values = dict(parameters or {})
        if name in SCENE_NAMES:
            require_parameters(name, values)
            values = {**(draw(name, seed) if seed is not None else {}), **values}
        self._client.call("set_scene", SLOW_CALL_TIMEOUT_S, name=name, parameters=values, rigid=rigid)
        self._hold()

    @needs_lease
    def set_parameters(self, values: Mapping[str, float]) -> None:
        """Change parameters of the scene while it runs."""
        require_parameters(self._client.require_snapshot()["scene"].decode(), values)
        self._client.call("set_parameters", SLOW_CALL_TIMEOUT_S, parameters=dict(values))

    @needs_lease
    def set_run(self, state: Literal["running", "paused"] | None, speed: float | None) -> dict[str, Any]:
        """Run or pause, at a speed; None leaves either as it is. Answers `{state, speed}`."""
        if speed is not None:
            speed = validated(RunRequest, {"state": state or "running", "speed": _plain(speed)})["speed"]
        return self._client.call("run", state=state, speed=speed)

    @needs_lease
    def step(self, ticks: int) -> dict[str, Any]:
        """Advance a paused simulation, at its own pace whatever the speed; answers `{time_s}` when done.

        Raises:
            RefusedError: it runs, or something came between: pause, e-stop, reset.
            ControlTimeoutError: the machine is too slow for so many; what is left of them is not made.
        """
        request = validated(StepRequest, {"ticks": _plain(ticks)})
        try:
            return self._client.call("step", SLOW_CALL_TIMEOUT_S, **request)
        except ControlTimeoutError:
            self._client.submit("run", state="paused", speed=None)
            raise

    @needs_lease
    def reset(self, seed: int | None = None, keyframe: str = "stand") -> None:
        """Put the simulated robot back, and the command to its default."""
        self._require_choice("keyframes", keyframe, "keyframe")
        self._client.call("reset", SLOW_CALL_TIMEOUT_S, seed=seed, keyframe=keyframe)
        self._hold()

    def estop(self) -> int:
        """Ask for the e-stop, without waiting for anything; `client.estops.taken` tells when the returned number has acted.

        What finds no control process, or one that hangs, is latched by the next one. A robot's I/O process is told too.
        """
        number = self._client.estops.ask()
        self.robot.estop()
        self.leadership.note("estop", {})
        return number

    @needs_lease
    def clear_estop(self) -> dict[str, Any]:
        """Clear the e-stop, with the command at its default; answers `{latched, mode}`.

        Raises:
            RefusedError: it was pressed again meanwhile.
        """
        asked = self._client.estops.asked
        self._hold()
        return self._client.call("clear_estop", estops=asked)

    @needs_lease
    def restart(self, *, force: bool) -> None:
        """Start a fresh control process in a hold: paused, default command, same scene and selection, e-stop kept.

        On hardware nothing is paused; the robot damps until somebody lets it stand up again.

        Raises:
            RefusedError: one is alive and `force` is not set, or another change is under way.
        """
        if self._client.alive and not force:
            raise RefusedError('the control process is alive; send {"force": true} to replace it')
        with self._switch():
            self._start(self.robot.choice, paused=True)

    def close(self) -> None:
        """End a recording, the control process, and a robot's I/O process even if the control process has died."""
        self.recordings.end()
        self.estimates.close()
        self._client.close()
        self.robot.end()

    @contextlib.contextmanager
    def _switch(self) -> Iterator[None]:
        if not self._switching.acquire(blocking=False):
            raise RefusedError("a control process is starting already; wait for it")
        try:
            yield
        finally:
            self._switching.release()

    def _start(self, choice: BackendChoice, *, paused: bool) -> None:
        """A fresh control process with the selection and the latched e-stop of the last one."""
        session = self._launch.session
        snapshot = self._client.snapshot()
        estopped = self._latched()
        if snapshot is not None and self.robot.choice.recording is None:
            pipeline = replace(
                session.pipeline, controller=snapshot["controller"].decode(), estimator=snapshot["estimator"].decode()
            )
            session = replace(session, pipeline=pipeline)
            if not on_hardware(snapshot):
                session = replace(session, scene=snapshot["scene"].decode())
        self._hold()
        self.recordings.end()
        self.selection = Selection()
        self.robot.choice = choice
        self._client.restart(session=session, estopped=estopped, **choice.launch(paused=paused))

    def _held_command(self) -> Command:
        """What an operator's change is a change of: his own command, or what a task holds that he takes over from."""
        snapshot = self._client.snapshot()
        if snapshot is None or not snapshot["task_in_charge"] or snapshot["command_sequence"] != self._sequence:
            return self._command
        return replace(command_from_record(snapshot["command"]), base_velocity=np.zeros(3), guidance=False)

    def _hold(self) -> None:
        self._client.write_setpoint(drag_active=False)  # first: a new sequence number says that all of the set-point is new
        with self._lock:
            self._command = clip_command(DEFAULT_COMMAND, self.limits)
            self._sequence += 1
            self._send()

    def _send(self) -> None:
        record = np.zeros(1, COMMAND)
        command_to_record(self._command, record[0])
        self._client.write_setpoint(command=record[0], sequence=self._sequence)

    def _latched(self) -> bool:
        snapshot = self._client.snapshot()
        return self._client.estops.pending or (snapshot is not None and snapshot["mode"] == Mode.ESTOP)

    def _note_selection(self, selection: Selection) -> None:
        self.selection = selection

    def _require_choice(self, kind: str, name: str, field: str = "name") -> None:
        choices = self.available()[kind]
        # What is not offered at all, the session refuses with what to do.
        if choices and name not in choices:
            raise InvalidFieldError(field, f"{name!r} does not exist", ", ".join(choices))


def _plain(value: Any) -> Any:
    """Numpy values as the lists and numbers that requests are made of."""
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    return list(value) if isinstance(value, tuple) else value
