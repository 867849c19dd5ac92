"""The robot's palette: physically based materials, linear colours."""

from dataclasses import dataclass
from typing import Literal

from trimesh.visual.material import PBRMaterial

MaterialName = Literal["shell", "dark", "trim", "metal", "rubber", "accent", "soft", "glass", "glow"]


@dataclass(frozen=True)
class Finish:
    """Base colour and emission (linear RGB, 0-1), metalness and roughness (0-1) as glTF 2.0 defines them."""

    color: tuple[float, float, float]
    metallic: float
    roughness: float
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)


PALETTE: dict[MaterialName, Finish] = {
    "shell": Finish((0.40, 0.41, 0.425), 0.0, 0.42),
    "dark": Finish((0.022, 0.024, 0.028), 0.25, 0.50),
    "trim": Finish((0.060, 0.065, 0.075), 0.40, 0.48),
    "metal": Finish((0.52, 0.54, 0.57), 0.95, 0.36),
    "rubber": Finish((0.011, 0.011, 0.012), 0.0, 0.88),
    "accent": Finish((0.72, 0.060, 0.006), 0.0, 0.45),
    "soft": Finish((0.46, 0.035, 0.010), 0.0, 0.95),
    "glass": Finish((0.004, 0.005, 0.007), 0.0, 0.06),
    "glow": Finish((0.0, 0.03, 0.05), 0.0, 0.60, (0.01, 0.55, 0.85)),
}


def pbr_material(name: MaterialName) -> PBRMaterial:
    """The palette entry as a trimesh material for glTF export."""
    finish = PALETTE[name]
    return PBRMaterial(
        name=name,
        baseColorFactor=[*finish.color, 1.0],
        metallicFactor=finish.metallic,
        roughnessFactor=finish.roughness,
        emissiveFactor=list(finish.emission),
    )
