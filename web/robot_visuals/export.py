"""From parts to GLB: one mesh per material, normals included."""

from collections.abc import Iterable

import numpy as np
import trimesh
from trimesh.exchange.gltf import export_glb
from trimesh.visual import TextureVisuals

from web.robot_visuals.materials import MaterialName, pbr_material
from web.robot_visuals.part import Part
from web.robot_visuals.shading import shade


def to_glb(parts: Iterable[Part]) -> bytes:
    """Binary glTF of one body in its own frame (m, z as in the MJCF), deterministic for equal parts."""
    by_material: dict[MaterialName, list[Part]] = {}
    for part in parts:
        by_material.setdefault(part.material, []).append(part)
    scene = trimesh.Scene()
    for material, group in by_material.items():
        shaded = [shade(part.surface) for part in group]
        offsets = np.cumsum([0, *(len(vertices) for vertices, _, _ in shaded[:-1])])
        mesh = trimesh.Trimesh(
            vertices=np.concatenate([vertices for vertices, _, _ in shaded]),
            vertex_normals=np.concatenate([normals for _, normals, _ in shaded]),
            faces=np.concatenate([faces + offset for (_, _, faces), offset in zip(shaded, offsets, strict=True)]),
            process=False,
        )
        mesh.visual = TextureVisuals(material=pbr_material(material))
        scene.add_geometry(mesh, geom_name=material, node_name=material)
    return export_glb(scene, include_normals=True)
