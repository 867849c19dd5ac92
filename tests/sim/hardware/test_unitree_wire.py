"""Golden bytes: what our codec writes is what the vendor's own classes write, and its CRC is the vendor's."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from control.joints import JOINT_NAMES
from sim.backends.unitree import motors
from sim.backends.unitree.crc import crc32_mpeg2, in_word_order
from sim.backends.unitree.layout import LOW_COMMAND, LOW_STATE
from sim.backends.unitree.messages import LowCommand, LowState, WireError

GOLDEN = json.loads((Path(__file__).parent / "golden" / "unitree.json").read_text())

# struct formats of the C structures that the vendor's CRC runs over (unitree_sdk2_python, utils/crc.py).
C_FORMAT = {
    "low_command": "<4B4IH2x" + "B3x5f3I" * 20 + "4B" + "55Bx2I",
    "low_state": "<4B4IH2x" + "13fb3x" + "B3x7fb3x3I" * 20 + "4BiH4b15H" + "8hI41B3xf2b2x2f4h2I",
}


def fill(message: LowCommand | LowState, fields: dict[str, Any]) -> None:
    for name, value in fields.items():
        if name != "motor":
            message.record[name] = value
            continue
        for key in value[0]:
            column = np.array([motor[key] for motor in value])
            if key == "mode":
                message.motor_mode = column
            else:
                message.motor[key] = column


@pytest.mark.parametrize(("case", "kind"), [("low_command", LowCommand), ("low_state", LowState), ("crc_example", LowCommand)])
def test_bytes_equal_the_vendor_serialiser(case: str, kind: type[LowCommand] | type[LowState]) -> None:
    golden = GOLDEN[case]
    message = kind()
    fill(message, golden["fields"])
    assert message.encode().hex() == golden["cdr_hex"]
    assert message.record["crc"] == golden["crc"]


@pytest.mark.parametrize(("case", "kind"), [("low_command", LowCommand), ("low_state", LowState)])
def test_decoding_the_vendor_bytes_returns_every_field(case: str, kind: type[LowCommand] | type[LowState]) -> None:
    golden = GOLDEN[case]
    message = kind.decode(bytes.fromhex(golden["cdr_hex"]))
    for name, value in golden["fields"].items():
        if name != "motor":
            np.testing.assert_array_equal(message.record[name], value)
    assert message.motor_mode.tolist() == [motor["mode"] for motor in golden["fields"]["motor"]]
    np.testing.assert_array_equal(message.motor["q"], [motor["q"] for motor in golden["fields"]["motor"]])
    np.testing.assert_array_equal(message.motor["reserve"], [motor["reserve"] for motor in golden["fields"]["motor"]])


@pytest.mark.parametrize(("case", "kind"), [("low_command", LowCommand), ("low_state", LowState)])
def test_c_image_unpacks_with_the_vendor_format(case: str, kind: type[LowCommand] | type[LowState]) -> None:
    message = kind.decode(bytes.fromhex(GOLDEN[case]["cdr_hex"]))
    image = message.data[message.c_image].tobytes()
    values = struct.unpack(C_FORMAT[case], image + bytes(4))
    repacked = struct.pack(C_FORMAT[case], *values)[:-4]
    assert repacked == image  # so every padding byte is zero and every value sits where the format says
    first_motor = GOLDEN[case]["fields"]["motor"][0]
    assert first_motor["mode"] in values and first_motor["q"] in values


def test_sizes_are_those_of_the_messages() -> None:
    assert (LOW_COMMAND.itemsize, LOW_STATE.itemsize) == (4 + 808, 4 + 1176)
    assert struct.calcsize(C_FORMAT["low_command"]) == 812
    assert struct.calcsize(C_FORMAT["low_state"]) == 1180


def test_crc_is_crc32_mpeg2() -> None:
    assert crc32_mpeg2(b"123456789") == 0x0376E6E7  # check value of the CRC catalogue


@given(st.binary(min_size=4, max_size=64).filter(lambda data: len(data) % 4 == 0))
def test_crc_equals_the_bitwise_definition(data: bytes) -> None:
    register = 0xFFFFFFFF
    for word in struct.unpack(f"<{len(data) // 4}I", data):
        for bit in range(31, -1, -1):
            feedback = (register >> 31) ^ (word >> bit & 1)
            register = (register << 1 & 0xFFFFFFFF) ^ (0x04C11DB7 if feedback else 0)
    assert crc32_mpeg2(in_word_order(np.frombuffer(data, np.uint8)).tobytes()) == register


@given(st.integers(4, 807), st.integers(0, 7))
def test_a_flipped_bit_is_refused(byte: int, bit: int) -> None:
    sample = bytearray(LowCommand().encode())
    sample[byte] ^= 1 << bit
    try:
        message = LowCommand.decode(bytes(sample))
    except WireError:
        return
    # Only padding is outside the CRC, and it carries nothing.
    assert message.data[message.c_image].tobytes() == LowCommand().data[LowCommand.c_image].tobytes()


@pytest.mark.parametrize(
    ("mangle", "says"),
    [
        (lambda s: s[:-1], "bytes"),
        (lambda s: s + b"\0", "bytes"),
        (lambda s: b"\x00\x07" + s[2:], "XCDR1"),  # XCDR2 little-endian
        (lambda s: b"\x00\x00" + s[2:], "XCDR1"),  # big-endian
        (lambda s: s[:-4] + b"\1\2\3\4", "CRC"),
    ],
)
def test_unsound_samples_are_refused(mangle: Any, says: str) -> None:
    with pytest.raises(WireError, match=says):
        LowState.decode(mangle(LowState().encode()))


def test_slots_follow_the_vendor_order_by_name() -> None:
    assert motors.SLOT_NAMES[:3] == ("FR_hip", "FR_thigh", "FR_calf")
    assert motors.SLOT_NAMES[12:] == ("FR_wheel", "FL_wheel", "RR_wheel", "RL_wheel")
    slots = np.arange(20.0)
    ours = motors.used_slots(slots)
    for joint, value in zip(JOINT_NAMES, ours, strict=False):
        assert motors.SLOT_NAMES[int(value)] == joint
    np.testing.assert_array_equal(ours[motors.JOINT_OF_SLOT], slots[:16])
