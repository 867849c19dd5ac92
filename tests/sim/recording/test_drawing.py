"""Transforms that are written as columns are what a reader of the schema finds."""

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms

from sim.recording.body_tree import BodyTree
from sim.recording.drawing import BASE, HAND, RESOLUTION, WORLD, TransformEncoder
from sim.runtime.snapshot import SNAPSHOT


def test_every_body_is_where_it_is_when_it_is() -> None:
    tree, rng = BodyTree.from_mjcf(), np.random.default_rng(2)
    snapshots = np.zeros(3, SNAPSHOT)
    for name in ("joint_position", "base_position", "end_effector_position_in_world", "heading_yaw"):
        snapshots[name] = rng.normal(size=snapshots[name].shape)
    snapshots["base_orientation_wxyz"] = (0.5, -0.5, 0.5, 0.5)
    times_ns = np.array([1_790_000_000_000_000_000, 1_790_000_000_000_000_127, 1_790_000_000_999_999_999], "u8")
    encoded = TransformEncoder(tree).batch(snapshots, times_ns)
    for snapshot, time_ns, data in zip(snapshots, times_ns.tolist(), encoded, strict=True):
        message = FrameTransforms.FromString(data.tobytes())
        found = {each.child_frame_id: each for each in message.transforms}
        assert found.keys() == {BASE, HAND, *tree.names[1:]}
        assert {each.timestamp.seconds * 10**9 + each.timestamp.nanos for each in message.transforms} == {time_ns}
        orientations = tree.orientations(snapshot["joint_position"])
        for index, (name, parent) in enumerate(zip(tree.names, tree.parents, strict=True)):
            if parent is not None:
                each = found[name]
                assert each.parent_frame_id == (BASE if parent == tree.names[0] else parent)
                at, turned = each.translation, each.rotation
                np.testing.assert_allclose([at.x, at.y, at.z], tree.positions[index], atol=RESOLUTION)
                np.testing.assert_allclose([turned.w, turned.x, turned.y, turned.z], orientations[index], atol=RESOLUTION)
        base, hand = found[BASE], found[HAND]
        assert base.parent_frame_id == hand.parent_frame_id == WORLD
        at, turned = base.translation, base.rotation
        np.testing.assert_allclose([at.x, at.y, at.z], snapshot["base_position"], atol=RESOLUTION)
        np.testing.assert_allclose([turned.w, turned.x, turned.y, turned.z], snapshot["base_orientation_wxyz"], atol=RESOLUTION)
        yaw = 2.0 * np.arctan2(hand.rotation.z, hand.rotation.w)
        np.testing.assert_allclose(yaw, snapshot["heading_yaw"], atol=4 * RESOLUTION)
