"""Wheel: tyre with staggered tread blocks, dished rim with five twin spokes, motor side closed."""

import numpy as np

from control.joints import WHEEL_HALF_WIDTH_M, WHEEL_RADIUS_M
from web.robot_visuals.part import Part
from web.robot_visuals.shapes import lathe
from web.robot_visuals.surface import Surface

CENTER_Y_M = 0.04
_SECTIONS = 32
_BLOCKS = 16
_SPOKES = 5
_TREAD_DEPTH_M = 0.0036
_SHOULDER_DROP_M = 0.0045
_SHOULDER_W_M = 0.0165


def wheel_parts() -> list[Part]:
    """Left wheel in its body frame: the axle is y, the outer face looks to +y, the tyre's centre is at y = +0.04."""
    face = WHEEL_HALF_WIDTH_M
    lip, dish = 0.90 * face, 0.001
    parts = [
        Part("rubber", _carcass()),
        *(Part("rubber", block) for block in _tread()),
        Part("metal", lathe([(0.0625, lip - 0.002), (0.0605, lip + 0.0012), (0.0560, lip + 0.0004)], "none", _SECTIONS)),
        Part("accent", lathe([(0.0560, lip + 0.0004), (0.0530, 0.0115)], "none", _SECTIONS)),
        Part("trim", lathe([(0.0530, 0.0115), (0.0500, dish), (0.0200, 0.004)], "none", _SECTIONS)),
        *(Part("shell", spoke) for spoke in _spokes(dish)),
        Part("dark", lathe([(0.0210, dish), (0.0200, face - 0.002), (0.0165, face)], "high")),
        Part("metal", lathe([(0.0120, face - 0.001), (0.0105, face + 0.0025)], "high")),
        Part("trim", lathe([(0.0300, -0.0175), (0.0560, -0.0155)], "none", _SECTIONS)),
        Part("metal", lathe([(0.0560, -0.0155), (0.0605, -lip - 0.0012), (0.0625, 0.002 - lip)], "none", _SECTIONS)),
        Part("dark", lathe([(0.0260, -0.0225), (0.0320, -0.0170)], "low")),
    ]
    return [Part(part.material, part.surface.turned("x", -np.pi / 2.0).moved(y=CENTER_Y_M)) for part in parts]


def _carcass() -> Surface:
    """Tyre between the tread blocks, bead to bead; the rim closes it inside."""
    half, crown = WHEEL_HALF_WIDTH_M, WHEEL_RADIUS_M - _TREAD_DEPTH_M
    upper = [(crown, 0.0), (crown - _SHOULDER_DROP_M, _SHOULDER_W_M), (0.0725, half), (0.0615, 0.86 * half)]
    return lathe([*((radius, -w) for radius, w in reversed(upper[1:])), *upper], "none", _SECTIONS)


def _tread() -> list[Surface]:
    """Slanted blocks in two rows, the second half a pitch behind the first."""
    pitch = 2.0 * np.pi / _BLOCKS
    row = [_block(pitch).turned("z", index * pitch) for index in range(_BLOCKS)]
    return row + [block.mirrored("z").turned("z", 0.5 * pitch) for block in row]


def _block(pitch: float) -> Surface:
    """One block of the upper row without its floor: inner edge at the crown, outer edge on the shoulder, swept back."""
    rings = []
    for w, radius, sweep in (
        (0.0010, WHEEL_RADIUS_M, 0.0),
        (_SHOULDER_W_M + 0.0005, WHEEL_RADIUS_M - _SHOULDER_DROP_M, 0.30),
    ):
        first, last = pitch * (sweep + np.array([0.0, 0.66]))
        floor = radius - 2.0 * _TREAD_DEPTH_M
        rings += [
            (r * np.cos(a), r * np.sin(a), w) for r, a in ((floor, first), (radius, first), (radius, last), (floor, last))
        ]
    faces = [(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7)]
    for here in range(3):
        faces += [(here, 1 + here, 5 + here), (here, 5 + here, 4 + here)]
    return Surface(np.array(rings), np.array(faces))


def _spokes(dish: float) -> list[Surface]:
    """Pairs of tapered bars from the hub to the rim."""
    bars = []
    for index in range(_SPOKES):
        for lean in (-1.0, 1.0):
            bar = _bar(dish).turned("z", lean * 0.10).moved(y=lean * 0.0036)
            bars.append(bar.turned("z", 2.0 * np.pi * index / _SPOKES))
    return bars


def _bar(dish: float) -> Surface:
    """Three visible sides of a bar along +u that falls from the hub's face to the rim."""
    rings = []
    for u, half, top in ((0.0160, 0.0040, 0.0170), (0.0555, 0.0032, 0.0125)):
        rings += [(u, half + 0.0006, dish), (u, half, top), (u, -half, top), (u, -half - 0.0006, dish)]
    faces = [face for here in range(3) for face in ((here, 1 + here, 5 + here), (here, 5 + here, 4 + here))]
    return Surface(np.array(rings), np.array(faces))
