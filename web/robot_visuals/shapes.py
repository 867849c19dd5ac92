"""Surfaces of which the robot's shells are made: turned profiles, rounded slabs and lofts, all wound outwards.

Lengths are metres. Every builder works along its own +w axis; `Surface.along` turns the result onto a body axis.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.interpolate import PchipInterpolator

from web.robot_visuals.surface import Surface

Caps = Literal["both", "low", "high", "none"]
"""Which ends of a solid get a flat cap; an end buried in another part needs none."""
Circle = tuple[float, float, float]
"""Centre u, centre v and radius in m."""

_POINT_SPREAD_M = 1e-7
_CHORD_ERROR_M = 0.0005


def arc_step(radius: float) -> float:
    """Angle in rad that one edge of an arc may span: its chord then strays from the arc by less than half a millimetre."""
    return 2.0 * float(np.arccos(max(1.0 - _CHORD_ERROR_M / max(radius, _CHORD_ERROR_M), 0.5)))


def lathe(profile: Sequence[tuple[float, float]], caps: Caps = "both", sections: int | None = None) -> Surface:
    """Turn (radius, w) points about the w axis; listed upwards along w, the surface faces away from the axis."""
    sections = sections or _sections(profile)
    angle = np.linspace(0.0, 2.0 * np.pi, sections, endpoint=False)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return _skin([_ring(circle * radius, w) for radius, w in profile], caps)


def slab(circles: Sequence[Circle], profile: Sequence[tuple[float, float]], caps: Caps = "both") -> Surface:
    """Raise the convex outline around `circles` along w: at each (inset, w) of `profile` the outline is drawn in by `inset`.

    One circle makes a disc, two a stadium, four a rounded box, unequal ones a tapered link.

    Raises:
        ValueError: an inset exceeds the radius of a circle on the outline, so the outline would fold over.
    """
    spans = _arcs(circles)
    depth = max(inset for inset, _ in profile)
    tightest = min(circles[index][2] for index, _, _ in spans)
    if depth > tightest:
        raise ValueError(f"inset {depth} exceeds the outline's smallest radius {tightest}; enlarge the circle or the profile")
    rings = []
    for inset, w in profile:
        points = []
        for index, start, end in spans:
            u, v, radius = circles[index]
            angle = np.linspace(start, end, int(np.ceil((end - start) / arc_step(radius) - 1e-9)) + 1)
            if len(spans) == 1:
                angle = angle[:-1]
            points.append(np.array([u, v]) + (radius - inset) * np.stack([np.cos(angle), np.sin(angle)], axis=1))
        rings.append(_ring(np.concatenate(points), w))
    return _skin(rings, caps)


def rounded(low: float, high: float, radius: float) -> list[tuple[float, float]]:
    """Slab profile from w = low to high with rounded edges: one face per edge, which area-weighted normals make look round."""
    return [(radius, low), (0.0, low + radius), (0.0, high - radius), (radius, high)]


@dataclass(frozen=True)
class Station:
    """Cross-section of a loft at height w: superellipse with centre (u, v), half sizes and exponent (2 ellipse, 4 boxy)."""

    w: float
    half_u: float
    half_v: float
    u: float = 0.0
    v: float = 0.0
    power: float = 2.6


def loft(stations: Sequence[Station], sections: int = 20, caps: Caps = "both") -> Surface:
    """Blend superellipse sections along w by monotone cubics, one ring at and one between the stations."""
    knots = np.array([(s.w, s.half_u, s.half_v, s.u, s.v, s.power) for s in stations])
    middles = 0.5 * (knots[:-1, 0] + knots[1:, 0]) if len(knots) > 2 else knots[:0, 0]
    at = np.sort(np.concatenate([knots[:, 0], middles]))
    curves = PchipInterpolator(knots[:, 0], knots[:, 1:])(at)
    angle = (np.arange(sections) + 0.5) * 2.0 * np.pi / sections
    cosine, sine = np.cos(angle), np.sin(angle)
    skin = []
    for w, (half_u, half_v, u, v, power) in zip(at, curves, strict=True):
        scale = (np.abs(cosine) ** power + np.abs(sine) ** power) ** (-1.0 / power)
        skin.append(_ring(np.stack([u + half_u * scale * cosine, v + half_v * scale * sine], axis=1), w))
    return _skin(skin, caps)


def _arcs(circles: Sequence[Circle]) -> list[tuple[int, float, float]]:
    """Arcs (circle index, start, end angle) of the outline around `circles`, counter-clockwise.

    The point of the outline with normal (cos t, sin t) lies on the circle whose support p . n + r is largest; drawing all
    radii in by the same inset leaves that choice as it is, which is why the rings of a slab correspond point by point.
    """
    table = np.asarray(circles, dtype=float)
    probe = (np.arange(720) + 0.5) * np.pi / 360.0
    owner = np.argmax(np.stack([np.cos(probe), np.sin(probe)], 1) @ table[:, :2].T + table[:, 2], axis=1)
    changes = np.flatnonzero(owner != np.roll(owner, 1))
    if len(changes) == 0:
        return [(int(owner[0]), 0.0, 2.0 * np.pi)]
    switches = [_switch_angle(table[owner[k - 1]], table[owner[k]], probe[k] - np.pi / 720.0) for k in changes]
    ends = [*switches[1:], switches[0] + 2.0 * np.pi]
    return [(int(owner[k]), start, end) for k, start, end in zip(changes, switches, ends, strict=True)]


def _switch_angle(before: np.ndarray, after: np.ndarray, near: float) -> float:
    """Angle close to `near` at which two circles have equal support: the normal of their common tangent."""
    du, dv, dr = before - after
    centre, spread = np.arctan2(dv, du), np.arccos(np.clip(-dr / np.hypot(du, dv), -1.0, 1.0))
    candidates = np.array([centre + spread, centre - spread])
    candidates += 2.0 * np.pi * np.round((near - candidates) / (2.0 * np.pi))
    return float(candidates[np.argmin(np.abs(candidates - near))])


def _sections(profile: Sequence[tuple[float, float]]) -> int:
    """Even number of sections that keeps the widest circle of a turned profile round."""
    return 2 * int(np.ceil(np.pi / arc_step(max(radius for radius, _ in profile))))


def _ring(points: np.ndarray, w: float) -> np.ndarray:
    return np.column_stack([points, np.full(len(points), w)])


def _band(lower: int, upper: int, count: int) -> np.ndarray:
    """Triangles between two rings of `count` vertices that start at vertex `lower` and `upper`."""
    here = np.arange(count)
    after = (here + 1) % count
    return np.concatenate(
        [
            np.stack([lower + here, lower + after, upper + after], axis=1),
            np.stack([lower + here, upper + after, upper + here], axis=1),
        ]
    )


def _skin(rings: Sequence[np.ndarray], caps: Caps) -> Surface:
    """Join rings (n, 3), listed upwards, into a surface; a ring shrunk to a point becomes an apex."""
    count = len(rings[0])
    vertices: list[np.ndarray] = []
    starts: list[tuple[int, bool]] = []
    total = 0
    for points in rings:
        apex = bool(np.ptp(points, axis=0).max() < _POINT_SPREAD_M)
        vertices.append(points[:1] if apex else points)
        starts.append((total, apex))
        total += 1 if apex else count
    here = np.arange(count)
    after = (here + 1) % count
    faces: list[np.ndarray] = []
    for (low, low_apex), (high, high_apex) in pairwise(starts):
        if low_apex:
            faces.append(np.stack([np.full(count, low), high + after, high + here], axis=1))
        elif high_apex:
            faces.append(np.stack([low + here, low + after, np.full(count, high)], axis=1))
        else:
            faces.append(_band(low, high, count))
    fan = np.stack([np.zeros(count - 2, int), here[1:-1], here[2:]], axis=1)
    (first, first_apex), (last, last_apex) = starts[0], starts[-1]
    if not first_apex and caps in ("both", "low"):
        faces.append(first + fan[:, ::-1])
    if not last_apex and caps in ("both", "high"):
        faces.append(last + fan)
    return Surface(np.concatenate(vertices), np.concatenate(faces))
