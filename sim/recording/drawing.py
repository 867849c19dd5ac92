"""The robot and the forces on its hand in Foxglove's own messages, which its 3-D panel and those of others show.

Frames are named as those panels expect them: `odom` is the world, `base_link` the trunk; the other bodies keep their names.
"""

import math
import struct
from pathlib import Path
from typing import Any, cast

import numpy as np
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.descriptor import FileDescriptor
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message

from sim.recording.body_tree import BodyTree

WORLD, BASE = "odom", "base_link"
METERS_PER_NEWTON = 0.01
"""Of an arrow."""

RESOLUTION = 2.0**-15
"""30 micrometres, or 60 microradians: nobody sees more, and what is random in a number cannot be compressed."""

HAND = "hand"
_STAMP_BYTES = 14
"""A time stamp: tag and length, then seconds and nanoseconds as a tag and a number of five bytes each."""

_ARROWS = (
    ("commanded", (230, 159, 0)),
    ("estimated", (0, 158, 115)),
    ("true", (236, 239, 244)),
)


def rounded(value: Any) -> Any:
    """A number, or an array of them, to RESOLUTION."""
    return RESOLUTION * np.round(value / RESOLUTION)


def descriptors_of(message: type[Message]) -> bytes:
    """Serialised FileDescriptorSet of a message type and all that it needs."""
    files = FileDescriptorSet()
    seen: set[str] = set()

    def add(file: FileDescriptor) -> None:
        if file.name not in seen:
            seen.add(file.name)
            for needed in file.dependencies:
                add(needed)
            file.CopyToProto(files.file.add())

    add(cast(FileDescriptor, message.DESCRIPTOR.file))
    return files.SerializeToString()


def frame_name(body: str, tree: BodyTree) -> str:
    """Frame of a body."""
    return BASE if body == tree.names[0] else body


class TransformEncoder:
    """Encodes where the robot's bodies are, and its hand's heading frame, as batches of foxglove.FrameTransforms.

    All messages have the same bytes but for numbers and time stamps, so that a batch is made by writing columns, as in
    sim.recording.wire: https://protobuf.dev/programming-guides/encoding.
    """

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


def robot_meshes(tree: BodyTree, visuals: Path, time_ns: int) -> bytes:
    """SceneUpdate that fixes the mesh of every body to its frame."""
    update = SceneUpdate()
    for name in tree.names:
        path = visuals / f"{name}.glb"
        if path.is_file():
            entity = update.entities.add(id=f"robot/{name}", frame_id=frame_name(name, tree), frame_locked=True)
            _stamp(entity.timestamp, time_ns)
            model = entity.models.add(data=path.read_bytes(), media_type="model/gltf-binary")
            model.scale.x = model.scale.y = model.scale.z = model.pose.orientation.w = 1.0
    return update.SerializeToString()


def arrows(snapshot: np.void, time_ns: int) -> bytes:
    """SceneUpdate with the forces on the hand: commanded where it is, estimated, and true where that is known."""
    applied = snapshot["applied_command"]
    commanded = np.where(applied["mask"] == 1, applied["force_n"], 0.0)
    forces = (commanded, snapshot["force_estimated_n"], snapshot["force_true_n"])
    update = SceneUpdate()
    for (name, color), force in zip(_ARROWS, forces, strict=True):
        entity = update.entities.add(id=f"force/{name}", frame_id=HAND)
        _stamp(entity.timestamp, time_ns)
        x, y, z = force.tolist()
        size = math.sqrt(x * x + y * y + z * z)
        if not size > 0.1:  # nor where it is not known
            continue
        length = rounded(METERS_PER_NEWTON * size)
        arrow = entity.arrows.add(shaft_length=length, shaft_diameter=0.015, head_length=0.04)
        arrow.head_diameter = 0.03
        arrow.color.r, arrow.color.g, arrow.color.b, arrow.color.a = *(channel / 255.0 for channel in color), 1.0
        rotation = arrow.pose.orientation
        rotation.w, rotation.x, rotation.y, rotation.z = map(rounded, _along(x / size, y / size, z / size))
    return update.SerializeToString()


def _along(x: float, y: float, z: float) -> tuple[float, float, float, float]:
    """Quaternion wxyz that turns the x axis, along which arrows lie, to a direction."""
    if x < -0.9999:
        return 0.0, 0.0, 0.0, 1.0
    scale = math.sqrt(2.0 * (1.0 + x))
    return 0.5 * scale, 0.0, -z / scale, y / scale


def _stamp(timestamp: object, time_ns: int) -> None:
    timestamp.seconds, timestamp.nanos = divmod(time_ns, 1_000_000_000)  # pyright: ignore[reportAttributeAccessIssue]


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
