"""The vendor's DDS types for cyclonedds 11: the types name and hash themselves on the network exactly as the vendor's do.

Every uint8 is declared `types.byte`. cyclonedds 11 would hash `types.uint8` differently from the 0.10 series on the robot,
and a 0.10 process that meets the unknown kind while looking the type up dies of a null pointer: a wrong declaration here
crashes other people's processes. tests/sim/hardware/test_unitree_idl.py compares the hashes with the vendor's headers.

LowCmd_ and LowState_ carry their bytes as they are; sim.backends.unitree.messages reads them. Request_ and Response_ are
rare and go through the library's serialiser.
"""

# The library builds types from annotations that are values, which no type checker can follow.
# pyright: reportCallIssue=false, reportGeneralTypeIssues=false, reportInvalidTypeForm=false, reportAttributeAccessIssue=false
# pyright: reportArgumentType=false

from dataclasses import dataclass
from typing import Any, TypeVar

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import autoid, final
from cyclonedds.idl.types import array, byte, float32, int16, int32, int64, sequence, uint16, uint32

_GO = "unitree_go.msg.dds_."
_API = "unitree_api.msg.dds_."


_Struct = TypeVar("_Struct", bound=IdlStruct)


def _raw(kind: type[_Struct]) -> type[_Struct]:
    """Make a type's samples stay bytes, encapsulation header included: `kind(data)`, `sample.data`.

    A base class would do the same, but the library counts bases into the type's identity.
    """

    def initialise(sample: Any, data: bytes) -> None:
        sample.data = data

    def serialize(sample: Any, buffer: Any = None, endianness: Any = None, use_version_2: bool | None = None) -> bytes:
        return sample.data

    def deserialize(cls: type, data: bytes, has_header: bool = True, use_version_2: bool | None = None) -> Any:
        return cls(bytes(data))

    kind.__init__ = initialise
    kind.serialize = serialize
    kind.deserialize = classmethod(deserialize)  # type: ignore[assignment]
    # The library calls this when a peer leaves; its own version would read fields that such a sample does not have.
    kind.deserialize_key = classmethod(deserialize)  # type: ignore[assignment]
    return kind


@final
@autoid("sequential")
class IMUState_(IdlStruct, typename=_GO + "IMUState_"):  # noqa: N801 (vendor's name)
    quaternion: array[float32, 4]
    gyroscope: array[float32, 3]
    accelerometer: array[float32, 3]
    rpy: array[float32, 3]
    temperature: byte


@final
@autoid("sequential")
class MotorState_(IdlStruct, typename=_GO + "MotorState_"):  # noqa: N801
    mode: byte
    q: float32
    dq: float32
    ddq: float32
    tau_est: float32
    q_raw: float32
    dq_raw: float32
    ddq_raw: float32
    temperature: byte
    lost: uint32
    reserve: array[uint32, 2]


@final
@autoid("sequential")
class BmsState_(IdlStruct, typename=_GO + "BmsState_"):  # noqa: N801
    version_high: byte
    version_low: byte
    status: byte
    soc: byte
    current: int32
    cycle: uint16
    bq_ntc: array[byte, 2]
    mcu_ntc: array[byte, 2]
    cell_vol: array[uint16, 15]


@final
@autoid("sequential")
class MotorCmd_(IdlStruct, typename=_GO + "MotorCmd_"):  # noqa: N801
    mode: byte
    q: float32
    dq: float32
    tau: float32
    kp: float32
    kd: float32
    reserve: array[uint32, 3]


@final
@autoid("sequential")
class BmsCmd_(IdlStruct, typename=_GO + "BmsCmd_"):  # noqa: N801
    off: byte
    reserve: array[byte, 3]


@_raw
@final
@autoid("sequential")
class LowCmd_(IdlStruct, typename=_GO + "LowCmd_"):  # noqa: N801
    head: array[byte, 2]
    level_flag: byte
    frame_reserve: byte
    sn: array[uint32, 2]
    version: array[uint32, 2]
    bandwidth: uint16
    motor_cmd: array[MotorCmd_, 20]
    bms_cmd: BmsCmd_
    wireless_remote: array[byte, 40]
    led: array[byte, 12]
    fan: array[byte, 2]
    gpio: byte
    reserve: uint32
    crc: uint32


@_raw
@final
@autoid("sequential")
class LowState_(IdlStruct, typename=_GO + "LowState_"):  # noqa: N801
    head: array[byte, 2]
    level_flag: byte
    frame_reserve: byte
    sn: array[uint32, 2]
    version: array[uint32, 2]
    bandwidth: uint16
    imu_state: IMUState_
    motor_state: array[MotorState_, 20]
    bms_state: BmsState_
    foot_force: array[int16, 4]
    foot_force_est: array[int16, 4]
    tick: uint32
    wireless_remote: array[byte, 40]
    bit_flag: byte
    adc_reel: float32
    temperature_ntc1: byte
    temperature_ntc2: byte
    power_v: float32
    power_a: float32
    fan_frequency: array[uint16, 4]
    reserve: uint32
    crc: uint32


@dataclass
@final
@autoid("sequential")
class RequestIdentity_(IdlStruct, typename=_API + "RequestIdentity_"):  # noqa: N801
    id: int64
    api_id: int64


@dataclass
@final
@autoid("sequential")
class RequestLease_(IdlStruct, typename=_API + "RequestLease_"):  # noqa: N801
    id: int64


@dataclass
@final
@autoid("sequential")
class RequestPolicy_(IdlStruct, typename=_API + "RequestPolicy_"):  # noqa: N801
    priority: int32
    noreply: bool


@dataclass
@final
@autoid("sequential")
class RequestHeader_(IdlStruct, typename=_API + "RequestHeader_"):  # noqa: N801
    identity: RequestIdentity_
    lease: RequestLease_
    policy: RequestPolicy_


@dataclass
@final
@autoid("sequential")
class Request_(IdlStruct, typename=_API + "Request_"):  # noqa: N801
    header: RequestHeader_
    parameter: str
    binary: sequence[byte]


@dataclass
@final
@autoid("sequential")
class ResponseStatus_(IdlStruct, typename=_API + "ResponseStatus_"):  # noqa: N801
    code: int32


@dataclass
@final
@autoid("sequential")
class ResponseHeader_(IdlStruct, typename=_API + "ResponseHeader_"):  # noqa: N801
    identity: RequestIdentity_
    status: ResponseStatus_


@dataclass
@final
@autoid("sequential")
class Response_(IdlStruct, typename=_API + "Response_"):  # noqa: N801
    header: ResponseHeader_
    data: str
    binary: sequence[byte]


def make_request(request_id: int, api_id: int, parameter: str) -> Request_:
    """A call with an answer, at normal priority, without a lease."""
    header = RequestHeader_(RequestIdentity_(request_id, api_id), RequestLease_(0), RequestPolicy_(0, False))
    return Request_(header, parameter, [])


def make_response(request_id: int, api_id: int, code: int, data: str) -> Response_:
    """The answer to the call of the same identity."""
    return Response_(ResponseHeader_(RequestIdentity_(request_id, api_id), ResponseStatus_(code)), data, [])
