"""Fixed layouts of `unitree_go::msg::dds_::LowCmd_` and `LowState_` on the wire (classic CDR, little-endian).

Both messages hold only numbers and fixed arrays, so every field has a fixed offset and a message is a numpy record over its
bytes. Two traps: CDR aligns each number to its own size but does not pad structures at their end, so the first motor's
`mode` sits two or three bytes away from where the stride of the other nineteen would put it; and the CRC covers the C
structure, which does pad. `C_IMAGE_*` maps one onto the other; padding never takes part.

Offsets count from the start of the sample, 4 bytes of encapsulation header included.
"""

from typing import Any

import numpy as np

MOTOR_SLOTS = 20
HEADER = bytes([0x00, 0x01, 0x00, 0x00])
"""Encapsulation header: classic CDR (XCDR1), little-endian. The payload of XCDR2 differs; it is refused."""

_MOTOR_COMMAND = np.dtype(
    {
        "names": ["mode", "q", "dq", "tau", "kp", "kd", "reserve"],
        "formats": ["u1", "<f4", "<f4", "<f4", "<f4", "<f4", ("<u4", 3)],
        "offsets": [0, 4, 8, 12, 16, 20, 24],
        "itemsize": 36,
    }
)
_MOTOR_STATE = np.dtype(
    {
        "names": ["mode", "q", "dq", "ddq", "tau_est", "q_raw", "dq_raw", "ddq_raw", "temperature", "lost", "reserve"],
        "formats": ["u1", *["<f4"] * 7, "u1", "<u4", ("<u4", 2)],
        "offsets": [0, 4, 8, 12, 16, 20, 24, 28, 32, 36, 40],
        "itemsize": 48,
    }
)


def _record(fields: list[tuple[str, object, int]], itemsize: int) -> np.dtype:
    names, formats, offsets = zip(*fields, strict=True)
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": itemsize})


_COMMON_HEAD: list[tuple[str, object, int]] = [
    ("header", ("u1", 4), 0),
    ("head", ("u1", 2), 4),
    ("level_flag", "u1", 6),
    ("frame_reserve", "u1", 7),
    ("sn", ("<u4", 2), 8),
    ("version", ("<u4", 2), 16),
    ("bandwidth", "<u2", 24),
]

LOW_COMMAND = _record(
    [
        *_COMMON_HEAD,
        ("motor", (_MOTOR_COMMAND, MOTOR_SLOTS), 24),  # motor[0]["mode"] would be 24: the true place is first_mode
        ("first_mode", "u1", 26),
        ("bms_off", "u1", 744),
        ("bms_reserve", ("u1", 3), 745),
        ("wireless_remote", ("u1", 40), 748),
        ("led", ("u1", 12), 788),
        ("fan", ("u1", 2), 800),
        ("gpio", "u1", 802),
        ("reserve", "<u4", 804),
        ("crc", "<u4", 808),
    ],
    812,
)

LOW_STATE = _record(
    [
        *_COMMON_HEAD,
        ("imu_quaternion", ("<f4", 4), 28),
        ("imu_gyroscope", ("<f4", 3), 44),
        ("imu_accelerometer", ("<f4", 3), 56),
        ("imu_rpy", ("<f4", 3), 68),
        ("imu_temperature", "u1", 80),
        ("motor", (_MOTOR_STATE, MOTOR_SLOTS), 80),  # motor[0]["mode"] would be 80: the true place is first_mode
        ("first_mode", "u1", 81),
        ("bms_version_high", "u1", 1040),
        ("bms_version_low", "u1", 1041),
        ("bms_status", "u1", 1042),
        ("bms_soc", "u1", 1043),
        ("bms_current", "<i4", 1044),
        ("bms_cycle", "<u2", 1048),
        ("bms_bq_ntc", ("u1", 2), 1050),
        ("bms_mcu_ntc", ("u1", 2), 1052),
        ("bms_cell_vol", ("<u2", 15), 1054),
        ("foot_force", ("<i2", 4), 1084),
        ("foot_force_est", ("<i2", 4), 1092),
        ("tick", "<u4", 1100),
        ("wireless_remote", ("u1", 40), 1104),
        ("bit_flag", "u1", 1144),
        ("adc_reel", "<f4", 1148),
        ("temperature_ntc1", "u1", 1152),
        ("temperature_ntc2", "u1", 1153),
        ("power_v", "<f4", 1156),
        ("power_a", "<f4", 1160),
        ("fan_frequency", ("<u2", 4), 1164),
        ("reserve", "<u4", 1172),
        ("crc", "<u4", 1176),
    ],
    1180,
)


def _c_image_source(dtype: np.dtype, first_mode: int, motors: int, shifts: list[tuple[str, int]]) -> np.ndarray:
    """Index of the sample's byte behind every byte of the C image (without its CRC word); padding reads the header's zero.

    Args:
        dtype: LOW_COMMAND or LOW_STATE.
        first_mode: offset of motor[0].mode in the C image.
        motors: offset of the motors in the C image.
        shifts: every other field with what to add to its payload offset.
    """
    source = np.zeros(dtype.itemsize, dtype=np.intp)  # the C image of both messages is as long as their sample
    fields: Any = dtype.fields
    for name, shift in shifts:
        kind, offset = fields[name][:2]
        source[offset - 4 + shift : offset - 4 + shift + kind.itemsize] = np.arange(offset, offset + kind.itemsize)
    array, start = fields["motor"][:2]
    motor: np.dtype = array.base
    columns: Any = motor.fields
    for slot in range(MOTOR_SLOTS):
        for name, (kind, offset, *_) in columns.items():
            wire = start + slot * motor.itemsize + offset
            image = motors + slot * motor.itemsize + offset
            if name == "mode" and slot == 0:
                wire, image = int(fields["first_mode"][1]), first_mode
            source[image : image + kind.itemsize] = np.arange(wire, wire + kind.itemsize)
    return source[:-4]


def _shifts(dtype: np.dtype, unshifted: set[str]) -> list[tuple[str, int]]:
    """Behind the motors' first padding the C image runs 4 bytes ahead of the payload."""
    skipped = {"header", "motor", "first_mode", "crc"}
    return [(name, 0 if name in unshifted else 4) for name in dtype.names or () if name not in skipped]


_HEAD_NAMES = {str(name) for name, _, _ in _COMMON_HEAD}
C_IMAGE_COMMAND = _c_image_source(LOW_COMMAND, 24, 24, _shifts(LOW_COMMAND, _HEAD_NAMES))
"""(808,) indices: C image of a LowCmd_ without its CRC word."""

C_IMAGE_STATE = _c_image_source(
    LOW_STATE,
    80,
    80,
    _shifts(
        LOW_STATE,
        _HEAD_NAMES | {"imu_quaternion", "imu_gyroscope", "imu_accelerometer", "imu_rpy", "imu_temperature"},
    ),
)
"""(1176,) indices: C image of a LowState_ without its CRC word."""
