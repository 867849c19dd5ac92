"""Where the robot's bodies are, as batches of foxglove.FrameTransforms.

All messages have the same bytes but for numbers and time stamps, so that a batch is made by writing columns, as in
sim.recording.wire: https://protobuf.dev/programming-guides/encoding. Numbers are rounded.
"""

import struct

import numpy as np

from sim.recording.body_tree import BodyTree
from sim.recording.drawing import WORLD, frame_name, rounded

HAND = "hand"
_STAMP_BYTES = 14
"""A time stamp: tag and length, then seconds and nanoseconds as a tag and a number of five bytes each."""


class TransformEncoder:
    """Encodes the transforms of one robot, and of its hand's heading frame."""

    def __init__(self, tree: BodyTree) -> None:
        self._tree = tree
        frames = [
            (WORLD if parent is None else frame_name(parent, tree), frame_name(name, tree))
            for name, parent in zip(tree.names, tree.parents, strict=True)
        ]
        message = bytearray()
        self._stamps, self._numbers = [], []
        for parent, child in (*frames, (WORLD, HAND)):
            transform, numbers = _transform(parent, child)
            message += b"\x0a" + _varint(len(transform))
            self._stamps.append(len(message))
            self._numbers += [len(message) + at for at in numbers]
            message += transform
        self._template = np.frombuffer(bytes(message), np.uint8)

    def batch(self, snapshots: np.ndarray, times_ns: np.ndarray) -> np.ndarray:
        """(n, length) bytes of messages, of SNAPSHOT records (n,) at times (n,)."""
        tree, count = self._tree, len(snapshots)
        places = np.zeros((count, len(tree.names) + 1, 7))  # x y z, then x y z w
        places[:, :-1, :3] = tree.positions
        places[:, :-1, 3:] = np.roll(tree.orientations(snapshots["joint_position"]), -1, axis=-1)
        places[:, 0, :3] = snapshots["base_position"]
        places[:, 0, 3:] = np.roll(snapshots["base_orientation_wxyz"], -1, axis=-1)
        half = 0.5 * snapshots["heading_yaw"]
        places[:, -1, :3] = snapshots["end_effector_position_in_world"]
        places[:, -1, 5], places[:, -1, 6] = np.sin(half), np.cos(half)
        messages = np.tile(self._template, (count, 1))
        numbers = rounded(places).reshape(count, -1).astype("<f8").view(np.uint8)
        messages[:, np.add.outer(self._numbers, np.arange(8)).ravel()] = numbers
        for at, values in ((3, times_ns // 10**9), (9, times_ns % 10**9)):
            digits = _five_bytes(values)
            for stamp in self._stamps:
                messages[:, stamp + at : stamp + at + 5] = digits
        return messages


def _transform(parent: str, child: str) -> tuple[bytes, list[int]]:
    """A foxglove.FrameTransform with zeros, and where its seven numbers are."""
    stamp = b"\x0a" + bytes([_STAMP_BYTES - 2]) + b"\x08" + bytes(5) + b"\x10" + bytes(5)
    data = bytearray(stamp)
    for tag, text in ((0x12, parent.encode()), (0x1A, child.encode())):
        data += bytes([tag]) + _varint(len(text)) + text
    numbers = []
    for tag, count in ((0x22, 3), (0x2A, 4)):
        data += bytes([tag, 9 * count])
        for number in range(1, count + 1):
            data += bytes([number << 3 | 1])
            numbers.append(len(data))
            data += struct.pack("<d", 0.0)
    return bytes(data), numbers


def _five_bytes(values: np.ndarray) -> np.ndarray:
    """(n, 5) varints of values (n,) below 2^35, all of the same length; that they have leading zeros is allowed."""
    digits = (values[:, None].astype("u8") >> np.arange(0, 35, 7, dtype="u8") & np.uint64(0x7F)).astype(np.uint8)
    digits[:, :-1] |= 0x80
    return digits


def _varint(value: int) -> bytes:
    return bytes([value & 0x7F | 0x80, value >> 7]) if value > 0x7F else bytes([value])
