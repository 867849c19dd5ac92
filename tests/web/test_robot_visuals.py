"""The robot's visuals: what is committed is what the generator makes, it fits the MJCF, and no face shows its back."""

import io

import mujoco
import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals

from control.joints import WHEEL_HALF_WIDTH_M, WHEEL_RADIUS_M
from web.robot_visuals import BODY_NAMES, VISUAL_FOLDER, MissingVisualError, build, load
from web.robot_visuals.shading import shade
from web.robot_visuals.shapes import Station, lathe, loft, rounded, slab
from web.robot_visuals.surface import Surface

MOST_FACES = 20_000
MOST_BYTES = 1_200_000
COVERED_WITHIN_M = 0.025
EXCESS_WITHIN_M = 0.07
HIP_EXCESS_WITHIN_M = 0.105  # the MJCF has no geom for the abduction motor
SLIVERS = 0.005  # rays that may slip between two polygons of unlike section counts
NORMAL_LENGTH_TOLERANCE = 1e-4


@pytest.fixture(scope="module")
def committed() -> dict[str, bytes]:
    return load()


@pytest.fixture(scope="module")
def meshes(committed: dict[str, bytes]) -> dict[str, list[trimesh.Trimesh]]:
    return {name: _meshes(data) for name, data in committed.items()}


@pytest.fixture(scope="module")
def model() -> mujoco.MjModel:
    return mujoco.MjModel.from_xml_path(str(VISUAL_FOLDER.parent / "robot.xml"))


def _meshes(data: bytes) -> list[trimesh.Trimesh]:
    scene = trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)
    return [geometry for geometry in scene.geometry.values() if isinstance(geometry, trimesh.Trimesh)]


def _material(part: trimesh.Trimesh) -> str:
    assert isinstance(part.visual, TextureVisuals)
    return part.visual.material.name


def _bounds(parts: list[trimesh.Trimesh]) -> np.ndarray:
    return np.array([np.min([p.bounds[0] for p in parts], axis=0), np.max([p.bounds[1] for p in parts], axis=0)])


def _triangles(parts: list[trimesh.Trimesh]) -> np.ndarray:
    return np.concatenate([part.triangles for part in parts])


def _collision_bounds(model: mujoco.MjModel, body: str) -> np.ndarray:
    """Bounds (2, 3) in m of the collision geoms of `body` in the body's frame."""
    corners = []
    signs = np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    for geom in np.flatnonzero(model.geom_bodyid == model.body(body).id):
        rotation = np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
        center, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
        corners.append(model.geom_pos[geom] + (center + signs * half) @ rotation.reshape(3, 3).T)
    points = np.concatenate(corners)
    return np.array([points.min(axis=0), points.max(axis=0)])


def test_every_body_of_the_robot_has_a_visual(model: mujoco.MjModel, committed: dict[str, bytes]) -> None:
    bodies = {model.body(index).name for index in range(1, model.nbody)}
    assert set(committed) == set(BODY_NAMES) == bodies


def test_committed_files_are_what_the_generator_makes(meshes: dict[str, list[trimesh.Trimesh]]) -> None:
    rebuilt = {name: _meshes(data) for name, data in build().items()}
    assert rebuilt.keys() == meshes.keys()
    for name, parts in meshes.items():
        assert [len(part.faces) for part in rebuilt[name]] == [len(part.faces) for part in parts], name
        np.testing.assert_allclose(_bounds(rebuilt[name]), _bounds(parts), atol=1e-6, err_msg=name)


def test_two_builds_give_the_same_bytes() -> None:
    assert build() == build()


def test_the_whole_robot_stays_light(committed: dict[str, bytes], meshes: dict[str, list[trimesh.Trimesh]]) -> None:
    assert sum(len(part.faces) for parts in meshes.values() for part in parts) <= MOST_FACES
    assert sum(map(len, committed.values())) <= MOST_BYTES


@pytest.mark.parametrize("body", BODY_NAMES)
def test_visual_agrees_with_the_collision_geoms(
    body: str, model: mujoco.MjModel, meshes: dict[str, list[trimesh.Trimesh]]
) -> None:
    collision, visual = _collision_bounds(model, body), _bounds(meshes[body])
    outward = np.array([[-1.0], [1.0]]) * (visual - collision)
    assert outward.min() > -COVERED_WITHIN_M, f"{body} collides where nothing is drawn: {outward}"
    assert outward.max() < (HIP_EXCESS_WITHIN_M if body.endswith("hip") else EXCESS_WITHIN_M), (
        f"{body} is drawn far outside its collision geoms: {outward}"
    )


@pytest.mark.parametrize(("body", "side"), [("FL_wheel", 1), ("FR_wheel", -1), ("RL_wheel", 1), ("RR_wheel", -1)])
def test_tyre_has_the_radius_and_width_of_the_contact_ellipsoid(
    body: str, side: int, meshes: dict[str, list[trimesh.Trimesh]]
) -> None:
    (tyre,) = [part for part in meshes[body] if _material(part) == "rubber"]
    from_axle = tyre.vertices - [0.0, 0.04 * side, 0.0]
    assert np.hypot(from_axle[:, 0], from_axle[:, 2]).max() == pytest.approx(WHEEL_RADIUS_M, abs=1e-6)
    assert np.abs(from_axle[:, 1]).max() == pytest.approx(WHEEL_HALF_WIDTH_M, abs=1e-6)


def test_tool_ball_is_the_contact_sphere(model: mujoco.MjModel, meshes: dict[str, list[trimesh.Trimesh]]) -> None:
    (ball,) = [part for part in meshes["end_effector"] if _material(part) == "soft"]
    np.testing.assert_allclose(np.linalg.norm(ball.vertices, axis=1), model.geom("end_effector").size[0], rtol=1e-5)


@pytest.mark.parametrize("body", BODY_NAMES)
def test_normals_are_unit_and_agree_with_the_winding(body: str, meshes: dict[str, list[trimesh.Trimesh]]) -> None:
    for part in meshes[body]:
        assert part.area_faces.min() > 1e-10, f"{body}: degenerate face in {_material(part)}"
        np.testing.assert_allclose(np.linalg.norm(part.vertex_normals, axis=1), 1.0, atol=NORMAL_LENGTH_TOLERANCE)
        agreement = np.einsum("fcx,fx->fc", part.vertex_normals[part.faces], part.face_normals)
        assert agreement.min() > 0.3, f"{body}: a normal of {_material(part)} leaves its face"


@pytest.mark.parametrize("body", BODY_NAMES)
def test_no_ray_from_outside_meets_the_back_of_a_face(body: str, meshes: dict[str, list[trimesh.Trimesh]]) -> None:
    """Renderers cull back faces: seen from anywhere around, the first face must be turned to the eye."""
    triangles = _triangles(meshes[body])
    origins, directions = _rays_from_outside(triangles, count=400)
    hits, backs = _first_hits(triangles, origins, directions)
    assert hits > 100
    assert backs <= SLIVERS * hits, f"{body}: {backs} of {hits} rays see the inside"


def _rays_from_outside(triangles: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays from random points of a surrounding sphere to random points of the faces."""
    random = np.random.default_rng(7)
    low, high = triangles.min(axis=(0, 1)), triangles.max(axis=(0, 1))
    toward = random.normal(size=(count, 3))
    toward /= np.linalg.norm(toward, axis=1, keepdims=True)
    origins = 0.5 * (low + high) + 2.0 * np.linalg.norm(high - low) * toward
    weights = random.dirichlet(np.ones(3), size=count)
    targets = np.einsum("nc,ncx->nx", weights, triangles[random.integers(len(triangles), size=count)])
    directions = targets - origins
    return origins, directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _first_hits(triangles: np.ndarray, origins: np.ndarray, directions: np.ndarray) -> tuple[int, int]:
    """How many rays hit a face, and how many of them see its back first (Moeller-Trumbore intersection)."""
    corner, edge1, edge2 = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(edge1, edge2)
    hits = backs = 0
    for origin, direction in zip(origins, directions, strict=True):
        p = np.cross(direction, edge2)
        determinant = np.einsum("fx,fx->f", edge1, p)
        with np.errstate(divide="ignore", invalid="ignore"):
            s = origin - corner
            u = np.einsum("fx,fx->f", s, p) / determinant
            q = np.cross(s, edge1)
            v = q @ direction / determinant
            distance = np.einsum("fx,fx->f", edge2, q) / determinant
        struck = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (distance > 0.0)
        if struck.any():
            hits += 1
            first = np.flatnonzero(struck)[np.argmin(distance[struck])]
            backs += int(normal[first] @ direction > 0.0)
    return hits, backs


@pytest.mark.parametrize("link", ["hip", "thigh", "calf", "wheel"])
def test_right_legs_mirror_left_legs(link: str, meshes: dict[str, list[trimesh.Trimesh]]) -> None:
    for front in "FR":
        left, right = _triangles(meshes[f"{front}L_{link}"]), _triangles(meshes[f"{front}R_{link}"])
        reflected = np.unique(np.round(left.reshape(-1, 3) * [1, -1, 1], 5), axis=0)
        np.testing.assert_array_equal(reflected + 0.0, np.unique(np.round(right.reshape(-1, 3), 5), axis=0) + 0.0)


def test_missing_file_names_the_cure(tmp_path) -> None:
    with pytest.raises(MissingVisualError, match=r"base\.glb is missing.*python -m web\.robot_visuals"):
        load(tmp_path)


SOLIDS = {
    "cylinder": lathe([(0.02, -0.01), (0.02, 0.03)]),
    "cone": lathe([(0.02, 0.0), (0.0, 0.05)]),
    "rounded box": slab([(x, y, 0.005) for x in (-0.02, 0.02) for y in (-0.01, 0.01)], rounded(0.0, 0.02, 0.003)),
    "tapered link": slab([(0.0, 0.0, 0.03), (0.2, 0.01, 0.01)], rounded(-0.01, 0.01, 0.004)),
    "loft": loft([Station(0.0, 0.02, 0.01), Station(0.05, 0.03, 0.02, u=0.01), Station(0.1, 0.01, 0.01)]),
}


@pytest.mark.parametrize("axis", ["x", "y", "z"])
@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_and_wound_outwards_however_placed(name: str, axis) -> None:
    solid = SOLIDS[name]
    volume = trimesh.Trimesh(solid.vertices, solid.faces).volume
    assert volume > 0.0
    for placed in (solid.along(axis), solid.mirrored(axis), solid.turned(axis, 0.7), solid.along(axis).moved(0.1, 0.2, 0.3)):
        mesh = trimesh.Trimesh(placed.vertices, placed.faces)
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(volume, rel=1e-9)


def test_slab_spans_its_circles_exactly() -> None:
    bounds = slab([(0.0, 0.0, 0.03), (0.2, 0.0, 0.01)], [(0.0, -0.01), (0.0, 0.02)]).vertices
    np.testing.assert_allclose([bounds.min(axis=0), bounds.max(axis=0)], [[-0.03, -0.03, -0.01], [0.21, 0.03, 0.02]], atol=5e-4)


def test_slab_refuses_an_inset_that_folds_the_outline() -> None:
    with pytest.raises(ValueError, match="inset"):
        slab([(0.0, 0.0, 0.01)], rounded(0.0, 0.05, 0.02))


def test_shading_keeps_right_angles_hard_and_shallow_edges_smooth() -> None:
    box = trimesh.creation.box()
    _, normals, faces = shade(Surface(box.vertices, box.faces))
    assert len(normals) == 24
    assert len(faces) == 12
    ball = trimesh.creation.icosphere(subdivisions=3)
    vertices, normals, _ = shade(Surface(ball.vertices, ball.faces))
    assert len(vertices) == len(ball.vertices)
    np.testing.assert_allclose(normals, vertices, atol=0.02)
