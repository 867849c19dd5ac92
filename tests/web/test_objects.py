"""Objects of every scene can be drawn and move with the snapshot."""

import numpy as np
import pytest
import trimesh
import viser

from sim.scenes import SCENE_NAMES, Primitive, build
from web.meshes import primitive_mesh
from web.objects import SceneObjects

KINDS = {
    "box": ([0.1, 0.2, 0.3], [0.2, 0.4, 0.6]),
    "sphere": ([0.1, 0.0, 0.0], [0.2, 0.2, 0.2]),
    "cylinder": ([0.1, 0.3, 0.0], [0.2, 0.2, 0.6]),
    "capsule": ([0.1, 0.3, 0.0], [0.2, 0.2, 0.8]),
    "ellipsoid": ([0.1, 0.2, 0.3], [0.2, 0.4, 0.6]),
}


def primitive(kind: str, size: list[float]) -> Primitive:
    return Primitive("geom", kind, np.array(size), "body", np.zeros(3), np.array([1.0, 0, 0, 0]), np.ones(4))


@pytest.mark.parametrize("kind", KINDS)
def test_a_primitive_has_the_extents_that_mujoco_gives_it(kind: str) -> None:
    size, extents = KINDS[kind]
    mesh = primitive_mesh(primitive(kind, size))
    assert isinstance(mesh, trimesh.Trimesh)
    np.testing.assert_allclose(mesh.extents, extents, rtol=0.03)
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), 0.0, atol=1e-3)


def test_what_cannot_be_drawn_is_named() -> None:
    with pytest.raises(ValueError, match="'geom' is a plane"):
        primitive_mesh(primitive("plane", [0.0, 0.0, 0.0]))


@pytest.mark.parametrize("name", SCENE_NAMES)
def test_every_scene_is_drawn_and_its_movable_bodies_follow(server: viser.ViserServer, snapshot: np.void, name: str) -> None:
    objects = SceneObjects(server)
    snapshot["scene"] = name.encode()
    movable = build(name).movable_bodies
    count = snapshot["object_count"] = len(movable)
    snapshot["object_position"][:count] = np.arange(3 * count).reshape(-1, 3) + 1.0
    snapshot["object_orientation_wxyz"][:count] = [0.0, 0.0, 0.0, 1.0]
    objects.update(snapshot)
    assert set(movable) <= set(objects.bodies)
    for index, body in enumerate(movable):
        np.testing.assert_allclose(objects.bodies[body].position, snapshot["object_position"][index])
