"""Request bodies of the REST interface. Ranges come from control.command.limits and sim.backends.simulation.mismatch."""

from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from control.command.limits import CommandLimits
from control.hand_load.tool import MAX_TOOL_CENTER_M, MAX_TOOL_KG
from control.timing import TICK_S
from server.fields import Mask, Number, RequestModel, Vector
from server.run_control import MAX_STEPS, REPLAY_SPEED_RANGE, SPEED_RANGE
from sim.backends.simulation.mismatch import MASS_SCALE_RANGE, PAYLOAD_RANGE_KG
from sim.runtime.snapshot import MAX_PARAMETERS

LIMITS = CommandLimits()

_FORCE = Vector((LIMITS.force_n,) * 3, "N")
_POSITION = Vector((LIMITS.position_x_m, LIMITS.position_y_m, LIMITS.position_z_m), "m")
_QUATERNION = Vector(((-1.0, 1.0),) * 4)
_VELOCITY = Vector((LIMITS.velocity_x_mps, LIMITS.velocity_y_mps, LIMITS.yaw_rate_rps), "m/s, m/s, rad/s")
_ANY_FORCE = Vector(((-200.0, 200.0),) * 3, "N")
_ANY_TORQUE = Vector(((-50.0, 50.0),) * 3, "N m")
_ANY_POINT = Vector(((-2.0, 2.0),) * 3, "m")
_TOOL_CENTER = Vector(((-MAX_TOOL_CENTER_M, MAX_TOOL_CENTER_M),) * 3, "m")
_DURATION = Number((TICK_S, 600.0), "s")
_GAIN = Number((0.1, 1000.0))
_TIME = Number((0.0, 1e9), "s")
_SEED = Number((0, 2**31 - 1))

MAX_LINKS = 64
MAX_OPTIONS = 32

Name = Annotated[str, Field(min_length=1, max_length=64)]


def _examples(*bodies: dict[str, Any]) -> ConfigDict:
    return ConfigDict(json_schema_extra={"examples": list(bodies)})


class CommandPatch(RequestModel):
    """Any subset of the full command: heading frame, forces of the environment on the robot."""

    model_config = _examples({"mask": [0, 0, 1], "force_n": [0, 0, 20]}, {"base_velocity": [0.3, 0, 0]})

    mask: Annotated[list[int], Mask()] = Field(default_factory=list)
    force_n: Annotated[list[float], _FORCE] = Field(default_factory=list)
    position_m: Annotated[list[float], _POSITION] = Field(default_factory=list)
    orientation_wxyz: Annotated[list[float], _QUATERNION] = Field(default_factory=list)
    base_velocity: Annotated[list[float], _VELOCITY] = Field(default_factory=list)
    guidance: bool = Field(default_factory=bool, description="zero-force guidance: the robot follows the hand")


class RunRequest(RequestModel):
    """Run or pause the simulation, optionally at another speed."""

    model_config = _examples({"state": "running", "speed": 1.0}, {"state": "paused"})

    state: Literal["running", "paused"]
    speed: Annotated[float, Number(SPEED_RANGE)] = Field(default_factory=float, description="simulated over wall-clock time")


class StepRequest(RequestModel):
    """Advance a paused simulation by ticks of 2 ms."""

    model_config = _examples({"ticks": 10})

    ticks: Annotated[int, Number((1, MAX_STEPS), "ticks")]


class ResetRequest(RequestModel):
    """Put the simulated robot back."""

    model_config = _examples({"seed": 7, "keyframe": "stand"}, {})

    seed: Annotated[int, _SEED] = Field(default_factory=int, description="of the sensors' errors; left out: as before")
    keyframe: Name = "stand"


class RestartRequest(RequestModel):
    """Start a fresh control process."""

    model_config = _examples({}, {"force": True})

    force: bool = False


class BackendOptions(RequestModel):
    """Which robot, and how. What is left out is as on the command line of the console."""

    dry_run: bool = Field(default_factory=bool, description="compute everything and send nothing; true unless said otherwise")
    allow_robot: bool = Field(
        default_factory=bool, description="consent to domain 0, other interfaces than lo, a remote arm; see --allow-robot"
    )
    domain: Annotated[int, Number((0, 230))] = Field(default_factory=int, description="DDS domain of the base")
    interface: Name = Field(default_factory=str, description="network interface that leads to the base")
    arm_host: Name = Field(default_factory=str, description="address of the arm's z1_ctrl")
    arm_port: Annotated[int, Number((1, 65534))] = Field(default_factory=int, description="z1_ctrl listens here")
    recording: Name = Field(default_factory=str, description="id of the recording to replay")


class BackendRequest(RequestModel):
    """Choose what the pipeline drives, or a recording to show. `options` are the robot's, or the recording's id."""

    model_config = _examples(
        {"name": "hardware", "options": {"dry_run": True}},
        {"name": "simulation"},
        {"name": "replay", "options": {"recording": "20261128-231500-000-push"}},
    )

    name: Literal["simulation", "hardware", "replay"]
    options: BackendOptions = Field(default_factory=BackendOptions)


class DriveRequest(RequestModel):
    """Ask the robot's drives for a change of state."""

    model_config = _examples({"request": "engage"}, {"request": "stand"})

    request: Literal["engage", "stand", "start", "hold", "sit", "damp", "release", "clear"]


class NameRequest(RequestModel):
    """Choose by name."""

    name: Name


class SceneRequest(NameRequest):
    """Choose the scene. What its parameters are, GET tells."""

    model_config = _examples({"name": "free"}, {"name": "door", "parameters": {"spring_scale": 2.0}})

    parameters: Annotated[dict[Name, float], Field(max_length=MAX_PARAMETERS)] = Field(default_factory=dict)
    seed: Annotated[int, _SEED] = Field(default_factory=int, description="draws the parameters that are not given")
    rigid: bool = Field(default_factory=bool, description="without padding on what the hand touches: its force chatters")


class SceneParametersRequest(RequestModel):
    """Change parameters of the scene while it runs."""

    model_config = _examples({"parameters": {}})

    parameters: Annotated[dict[Name, float], Field(max_length=MAX_PARAMETERS)]


class TaskRequest(RequestModel):
    """Begin a task. What its options are, GET tells."""

    model_config = _examples({"name": "wipe", "options": {"force_n": 15}}, {"name": "guidance", "options": {}})

    name: Name
    options: Annotated[dict[Name, float], Field(max_length=MAX_OPTIONS)] = Field(default_factory=dict)


class ControllerRequest(NameRequest):
    """Choose the controller."""

    model_config = _examples({"name": "model_based"})


class LeaseRequest(RequestModel):
    """Command alone."""

    model_config = _examples({"operator": "Ada"}, {"operator": "Grace", "take_over": True})

    operator: Name = Field(description="whom the others see")
    take_over: bool = Field(default=False, description="also from another who holds it; the base stops")


class Gains(RequestModel):
    """Gains of the generalized momentum observer."""

    k1: Annotated[float, _GAIN]
    k2: Annotated[float, _GAIN]


class EstimatorRequest(NameRequest):
    """Choose the force estimator, optionally with new observer gains."""

    model_config = _examples({"name": "adaptive"}, {"name": "gmo_cqp", "gains": {"k1": 6.0, "k2": 20.0}})

    gains: Gains = Field(default_factory=lambda: Gains(k1=1.0, k2=1.0))


class MismatchRequest(RequestModel):
    """Scale the masses of the simulated robot; the estimator is not told."""

    model_config = _examples({"mass_scale": 1.2}, {"mass_scale": 1.0, "per_link": {"base": 1.3}})

    mass_scale: Annotated[float, Number(MASS_SCALE_RANGE)]
    per_link: dict[Name, Annotated[float, Number(MASS_SCALE_RANGE)]] = Field(default_factory=dict, max_length=MAX_LINKS)
    payload_kg: Annotated[float, Number(PAYLOAD_RANGE_KG, "kg")] = Field(default=0.0, description="that the hand carries")
    payload_center_m: Annotated[list[float], _TOOL_CENTER] = Field(
        default=[0.0, 0.0, 0.0], description="in the end effector's frame"
    )


class ToolRequest(RequestModel):
    """Tell what the hand carries beyond the nominal end effector."""

    model_config = _examples({"mass_kg": 0.8, "center_of_mass_m": [0.05, 0, 0]}, {"mass_kg": 0, "center_of_mass_m": [0, 0, 0]})

    mass_kg: Annotated[float, Number((0.0, MAX_TOOL_KG), "kg")]
    center_of_mass_m: Annotated[list[float], _TOOL_CENTER] = Field(description="in the end effector's frame")


class RecordingRequest(RequestModel):
    """Start a recording."""

    model_config = _examples({"name": "push", "note": "with the new gains"}, {})

    name: Annotated[str, Field(max_length=64)] = ""
    note: Annotated[str, Field(max_length=1000)] = ""


class EstimatesRequest(RequestModel):
    """Run an estimator over a recording."""

    model_config = _examples({"estimator": "gmo_cqp", "gains": {"k1": 12.0, "k2": 80.0}})

    estimator: Name
    gains: Gains = Field(default_factory=lambda: Gains(k1=1.0, k2=1.0))


class ReplayRequest(RequestModel):
    """Any subset: where and how fast a recording is shown."""

    model_config = _examples({"time_s": 3.5, "state": "paused"}, {"speed": 8})

    time_s: Annotated[float, _TIME] = Field(default_factory=float, description="since the recording's start")
    state: Literal["playing", "paused"] = Field(default_factory=lambda: "playing")
    speed: Annotated[float, Number(REPLAY_SPEED_RANGE)] = Field(default_factory=float, description="1: as it happened")


class SeekRequest(RequestModel):
    """Show a moment of the last minute."""

    model_config = _examples({"time_s": 1.2})

    time_s: Annotated[float, _TIME] = Field(description="simulated time")


class BranchRequest(RequestModel):
    """Go on from a moment of the last minute, with something changed."""

    model_config = _examples({"time_s": 1.2, "estimator": "adaptive"}, {"controller": "model_based", "mass_scale": 1.2}, {})

    time_s: Annotated[float, _TIME] = Field(default_factory=float, description="simulated time; left out: of what is shown")
    controller: Name = Field(default_factory=str, description="from then on")
    estimator: Name = Field(default_factory=str, description="from then on")
    gains: Gains = Field(default_factory=lambda: Gains(k1=1.0, k2=1.0))
    mass_scale: Annotated[float, Number(MASS_SCALE_RANGE)] = Field(
        default_factory=float, description="of the simulated robot; the estimator is not told"
    )


class WrenchRequest(RequestModel):
    """An exact wrench on a simulated body; expires by itself."""

    model_config = _examples({"force_n": [0, 0, -20], "frame": "heading", "duration_s": 2.0, "ramp_s": 0.2})

    force_n: Annotated[list[float], _ANY_FORCE]
    torque_nm: Annotated[list[float], _ANY_TORQUE] = Field(default=[0.0, 0.0, 0.0])
    point_m: Annotated[list[float], _ANY_POINT] = Field(default=[0.0, 0.0, 0.0], description="in the body's frame")
    body: Name = "end_effector"
    frame: Literal["world", "heading", "body"]
    duration_s: Annotated[float, _DURATION]
    ramp_s: Annotated[float, Number((0.0, 300.0), "s")] = 0.0

    @model_validator(mode="after")
    def _ramps_fit(self) -> "WrenchRequest":
        if self.ramp_s > 0.5 * self.duration_s:
            allowed = f"0 to half of duration_s, {0.5 * self.duration_s:g} s"
            raise PydanticCustomError("refused", "is too long", {"field": "ramp_s", "allowed": allowed})
        return self
