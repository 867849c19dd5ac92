"""The robot's meshes and the forces on its hand in Foxglove's own messages, which its 3-D panel and those of others show.

Frames are named as those panels expect them: `odom` is the world, `base_link` the trunk; the other bodies keep their names.
"""

import math
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
        entity = update.entities.add(id=f"force/{name}", frame_id="hand")
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
