"""Triangles of what the scene shows that is no file: primitives of a scene's model, and the robot's bodies in one piece."""

from functools import cache

import trimesh

from sim.scenes import Primitive
from web.scene import VISUALS


@cache
def body_mesh(body: str) -> trimesh.Trimesh | None:
    """All that is drawn of a body of the robot, in its own frame, m; None where nothing is."""
    path = VISUALS / f"{body}.glb"
    return trimesh.load_scene(path).to_mesh() if path.is_file() else None


def primitive_mesh(primitive: Primitive) -> trimesh.Trimesh:
    """Triangles of a primitive in its own frame, m.

    Raises:
        ValueError: a kind of geom that has no finite surface.
    """
    a, b, _ = primitive.size
    match primitive.kind:
        case "box":
            return trimesh.creation.box(extents=2.0 * primitive.size)
        case "sphere":
            return trimesh.creation.icosphere(subdivisions=3, radius=a)
        case "cylinder":
            return trimesh.creation.cylinder(radius=a, height=2.0 * b, sections=48)
        case "capsule":
            return trimesh.creation.capsule(radius=a, height=2.0 * b, count=(24, 24))
        case "ellipsoid":
            return trimesh.creation.icosphere(subdivisions=3).apply_scale(primitive.size)
    raise ValueError(f"geom {primitive.name!r} is a {primitive.kind}, which cannot be drawn as an object of a scene")
