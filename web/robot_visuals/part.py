"""A part is one solid in one material; bodies are lists of parts in the body's own frame."""

from collections.abc import Iterable
from dataclasses import dataclass

from web.robot_visuals.materials import MaterialName
from web.robot_visuals.surface import Axis, Surface


@dataclass(frozen=True)
class Part:
    """A surface and the palette entry that paints it."""

    material: MaterialName
    surface: Surface


def moved(parts: Iterable[Part], x: float = 0.0, y: float = 0.0, z: float = 0.0) -> list[Part]:
    """Shift parts by metres."""
    return [Part(part.material, part.surface.moved(x, y, z)) for part in parts]


def mirrored(parts: Iterable[Part], axis: Axis) -> list[Part]:
    """Reflect parts through the plane normal to `axis`; faces stay wound outwards."""
    return [Part(part.material, part.surface.mirrored(axis)) for part in parts]


def both_sides(parts: Iterable[Part], axis: Axis) -> list[Part]:
    """The parts and their mirror images."""
    kept = list(parts)
    return kept + mirrored(kept, axis)
