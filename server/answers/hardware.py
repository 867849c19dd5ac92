"""Schema of a robot's drives and its link."""

from typing import Annotated

from control.joints import JOINT_NAMES
from server.answers.schema import Answer, OneOf, names_of
from sim.backends.hardware.states import REQUEST_NAMES, DriveState


class Battery(Answer):
    """As the base reports it; null before it was heard."""

    percent: int | None
    """% of its charge"""
    voltage_v: float | None
    """V"""


class Link(Answer):
    """The I/O process and its wire."""

    io_age_ms: float | None
    """ms, since the I/O process reported"""
    base_age_ms: float | None
    """ms, since the base sent a state; null before the first"""
    arm_age_ms: float | None
    """ms, since the arm sent a state; null before the first"""
    latency_ms: float
    """ms, from a state's arrival to the command on the network"""
    worst_period_ms: float
    """ms, longest time between two ticks of the I/O process in the last second; 2 is the aim"""
    states_received: int
    """of the base"""
    states_missed: int
    """of the base, by gaps in their ticks"""
    bad_messages: int
    """that failed their checksum or could not be read"""
    frames_sent: int
    """commands to the base"""
    foreign_writers: int
    """other programs that command the motors"""
    realtime_scheduling: bool
    """SCHED_FIFO was granted to the I/O process"""


class Motor(Answer):
    """A motor; null before it was heard."""

    name: Annotated[str, OneOf(JOINT_NAMES)]
    """of its joint"""
    temperature_c: float | None
    """degrees Celsius"""
    torque_nm: float | None
    """N m, on the joint"""
    lost: int | None
    """messages that the base lost on the way to it; null for the arm, which does not count them"""


class HardwareAnswer(Answer):
    """Drives, faults, battery, motors and link, as the I/O process reports them."""

    state: Annotated[str, names_of(DriveState)]
    """of the drives"""
    requests: list[Annotated[str, OneOf(REQUEST_NAMES)]]
    """what may be asked for now"""
    engaging: bool
    """release of the robot's own program and self-test are under way"""
    progress: float
    """0 to 1, of engaging, standing up or sitting down"""
    dry_run: bool
    """everything is computed and nothing is sent"""
    verified: str
    """how far this backend has been tried"""
    faults: list[str]
    """why the drives damp, in words"""
    warnings: list[str]
    """in words"""
    message: str
    """last refusal, failure or fault"""
    battery: Battery
    link: Link
    motors: list[Motor]
    """22, in the order of the joints"""
