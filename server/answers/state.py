"""Schema of the state: `GET /api/v1/state`, and what the stream sends parts of."""

from typing import Annotated

from control.estimation.mistrust import EstimatorFlag
from control.faults import Fault
from control.joints import JOINT_NAMES, LEGS
from server.answers.command import CommandFields
from server.answers.schema import Answer, OneOf, PerJoint, Quaternion, Vector2, Vector3, names_of
from server.answers.tasks import OutcomeName
from sim.backends.hardware.states import DriveState
from sim.runtime.fault_words import BACKEND_FAILED, CONTROL_PROCESS_DEAD, CONTROL_PROCESS_SILENT, LOOP_OVERRUNS
from sim.runtime.snapshot import Mode

_FLAGS = OneOf(tuple(str(flag.name) for flag in EstimatorFlag if flag))
_FAULTS = OneOf(
    (
        BACKEND_FAILED,
        *(fault.name for fault in Fault if fault.name is not None),
        LOOP_OVERRUNS,
        CONTROL_PROCESS_DEAD,
        CONTROL_PROCESS_SILENT,
    ),
)


class Base(Answer):
    """The trunk."""

    position_m: Vector3 | None
    """m, in world, of the base frame's origin: true in simulation, by odometry and leg kinematics on hardware"""
    orientation_wxyz: Quaternion | None
    """of the base in world: true in simulation, by the IMU on hardware"""
    linear_velocity_mps: Vector3 | None
    """m/s, heading, estimated from IMU and joints"""
    angular_velocity_rps: Vector3 | None
    """rad/s, in base, as the gyroscope measures it"""


class Odometry(Answer):
    """Where the robot has rolled to since its pipeline was last reset: by wheels and IMU, in simulation too."""

    position_m: Vector2
    """m, of the base origin; the frame lay below it at the reset, x ahead"""
    yaw_rad: float
    """rad turned since, counterclockwise, not wrapped"""
    sigma_m: float
    """m, estimated standard deviation of the position"""


class Joints(Answer):
    """The 22 joints in the order of `names`, as measured."""

    names: list[Annotated[str, OneOf(JOINT_NAMES)]]
    """four legs (hip, thigh, calf), four wheels, six joints of the arm"""
    position: PerJoint
    """rad"""
    velocity: PerJoint
    """rad/s"""
    torque: PerJoint
    """N m, of the motor on the joint"""


class EndEffector(Answer):
    """The hand, and the force of the environment on it."""

    position_m: Vector3 | None
    """m, heading, by the joints' encoders"""
    orientation_wxyz: Quaternion | None
    """in heading, by the joints' encoders"""
    force_estimated_n: Vector3 | None
    """N, heading, by the selected estimator: what the controller feels"""
    force_estimates_n: dict[str, Vector3 | None]
    """N, heading, by the name of each estimator; null before its first"""
    force_of_controller_n: Vector3 | None
    """N, heading, by the controller itself, which looks at no estimator then; null where it makes none"""
    force_true_n: Vector3 | None
    """N, heading, from the simulator; null on hardware"""
    force_sigma_n: Vector3 | None
    """N, heading, standard deviation per axis that the selected estimator states; null where it states none"""


class Contact(Answer):
    """A wheel on the ground."""

    wheel: Annotated[str, OneOf(LEGS)]
    """front or rear, left or right"""
    in_contact: bool
    """true contact in simulation; on hardware an estimated normal force above 5 N"""
    force_estimated_n: Vector3 | None
    """N, heading, of the ground on the wheel, by the selected estimator"""
    force_true_n: Vector3 | None
    """N, heading, from the simulator; null on hardware"""


class Drive(Answer):
    """The drives of a robot."""

    state: Annotated[str, names_of(DriveState)]
    """in `policy` the controller moves the robot; `disconnected` and `observe` send nothing"""
    faults: list[str]
    """why the drives damp, in words"""
    dry_run: bool
    """everything is computed and nothing is sent"""


class CurrentRecording(Answer):
    """The recording under way."""

    id: str
    """in the path of its calls"""
    duration_s: float
    """s, of the robot's time"""
    size_bytes: int
    """of the file so far"""


class Loop(Answer):
    """How the control loop keeps time."""

    rate_hz: float
    """ticks per second of wall-clock time; a tick is 2 ms of the robot's"""
    real_time_factor: float
    """simulated over wall-clock time, measured"""
    overruns: int
    """ticks that missed their deadline, since the control process started"""
    overruns_last_minute: int
    """ticks that missed their deadline within the last minute"""
    overrun_share: float
    """share of the last seconds' ticks that missed their deadline"""
    lateness_p99_ms: float
    """ms, 99 % of the last ticks began at most this late"""
    tick_median_us: float
    """us, median work of a tick"""
    rebases: int
    """times the loop fell so far behind that it dropped the lost time"""
    held_s: float
    """s, spent on slow work that was asked for, such as loading a scene"""
    realtime_scheduling: bool
    """SCHED_FIFO was granted"""
    speed: float
    """simulated over wall-clock time, as asked"""


class TaskState(Answer):
    """A task; GET /api/v1/tasks/current tells more."""

    id: int
    """names it in GET and DELETE"""
    name: str
    """of the task"""
    phase: str
    """what it does now, or did last"""
    progress: float
    """0 to 1"""
    outcome: OutcomeName | None
    """null while it is at work"""
    in_charge: bool
    """it commands, or holds what it commanded last; any command of an operator takes over"""


class StateAnswer(Answer):
    """One consistent snapshot, taken after a tick."""

    time_s: float
    """s, of the simulation since its reset, or of the robot's session"""
    wall_time_s: float
    """s since 1970, UTC"""
    sequence: int
    """counts snapshots"""
    stale_s: float
    """s, for how long nothing newer has come from a control process that is dead, hangs or is busy; 0 while all is well"""
    mode: Annotated[str, names_of(Mode)]
    """`estop` while the e-stop is latched, `fault` while the drives damp for another reason"""
    faults: list[Annotated[str, _FAULTS]]
    """why the safety gate damps, or what it limits; or that the backend failed, or that the control process is dead, silent or
    too slow"""
    fault_words: dict[str, str]
    """each of `faults` in words; a controller or an estimator that failed is named with its exception"""
    message: str | None
    """why the robot does not obey, in one sentence; null while it does"""
    failure: str | None
    """why the backend steps no more, such as a simulation that diverged, with the cure; null while it does"""
    backend: str
    """what the pipeline drives"""
    drive: Drive | None
    """of a robot; null in simulation"""
    scene: str
    """name of the simulated scene"""
    controller: str
    """name of the selected controller"""
    estimator: str
    """name of the selected estimator"""
    command_sequence: int
    """`sequence` of the newest command that was taken in"""
    command: CommandFields
    """as asked, within limits"""
    applied_command: CommandFields
    """as applied: the command asked for after guidance, limits, the tip-over limit and rate limits"""
    base: Base
    odometry: Odometry
    joints: Joints
    end_effector: EndEffector
    contacts: list[Contact]
    """one per wheel"""
    mass_scale_estimated: float | None
    """estimated mass over the model's; null where the selected estimator estimates none"""
    mass_scale_true: float | None
    """mass of the simulated robot over the model's; null on hardware"""
    mass_adapting: bool
    """the masses that the selected estimator finds still move: until they rest, its force may be off by more than its standard
    deviation says; false where it estimates none"""
    estimator_flags: list[Annotated[str, _FLAGS]]
    """why the selected estimate is to be mistrusted: an arm joint at its end, a contact of the arm with the robot, a contact
    elsewhere than at the hand, masses that still adapt; `force_sigma_n` is wider for the first three"""
    readings: dict[str, float | None]
    """what can be read off the scene, by name with its unit, such as `valve_angle_rad`; empty on a robot"""
    task: TaskState | None
    """the task that was begun last; null before the first"""
    recording: CurrentRecording | None
    """the one under way; null without one"""
    loop: Loop
