"""Board wiping (paper Sec. IV.B): follow a pattern on a board (x, y) while the force along its normal is regulated.

The board may lean and swell by some millimetres, of which the task knows nothing. The pattern is a figure of eight that lies
across it.
"""

from collections.abc import Mapping

import mujoco
import numpy as np

from control.frames import rotation_from_quaternion
from sim.scenes.scene import Parameter, Reading

DESCRIPTION = "A board to wipe: position along x and y, force along z"

TOP_HEIGHT_M = 0.42
CENTER_X_M = 0.62
FRICTION = 0.35
PARAMETERS = (
    Parameter("height_m", TOP_HEIGHT_M, 0.38, 0.48, drawn=(0.405, 0.435)),
    Parameter("pitch_rad", 0.0, -0.1, 0.1, drawn=(-0.05, 0.05)),
    Parameter("roll_rad", 0.0, -0.1, 0.1, drawn=(-0.05, 0.05)),
    Parameter("wave_m", 0.0, 0.0, 0.006, drawn=(0.0, 0.003)),
    Parameter("friction", FRICTION, 0.05, 0.8, drawn=(0.2, 0.45)),
)

PATTERN_CENTER_M = (0.60, 0.0)
PATTERN_HALF_M = (0.06, 0.15)
WIPED_WITHIN_M = 0.02
"""A point of the pattern is wiped when the pressing hand passes so close."""
_HALF_X_M, _HALF_Y_M, _HALF_THICKNESS_M = 0.20, 0.30, 0.015
_BUMP_HALF_M = 0.09
_BUMP_PLACES_M = ((-0.07, -0.13), (-0.07, 0.02), (-0.07, 0.16), (0.06, -0.18), (0.06, -0.05), (0.06, 0.10))
"""On the board, from its middle."""
_BUMPS = tuple(f"board_bump_{index}" for index in range(len(_BUMP_PLACES_M)))
_WHITE = [0.93, 0.94, 0.96, 1.0]
PADDED = ("board", *_BUMPS)


def pattern(phase_rad: np.ndarray | float, half_m: tuple[float, float] = PATTERN_HALF_M) -> np.ndarray:
    """Points (..., 2) m of the figure of eight on the board, x and y in the scene's frame; closed after 2 pi."""
    x = PATTERN_CENTER_M[0] + half_m[0] * np.sin(2.0 * np.asarray(phase_rad))
    return np.stack([x, PATTERN_CENTER_M[1] + half_m[1] * np.sin(phase_rad)], axis=-1)


class WipedShare:
    """Share of the pattern that the hand has wiped, pressing on the board, since the start of the simulation."""

    STATE = ("_wiped", "_time_s")

    def __init__(self) -> None:
        self._points = pattern(np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False))
        self._wiped = np.zeros(len(self._points), bool)
        self._time_s = 0.0

    def read(self, data: mujoco.MjData) -> float:
        """The share, after the tick of `data`."""
        if data.time < self._time_s:
            self._wiped[:] = False
        self._time_s = data.time
        hand, board = data.geom("end_effector"), data.geom("board")
        surface = {data.geom(name).id for name in PADDED}
        if any(hand.id in pair and not surface.isdisjoint(pair) for pair in data.contact.geom.tolist()):
            place = (hand.xpos - board.xpos) @ board.xmat.reshape(3, 3)[:, :2] + [CENTER_X_M, 0.0]
            self._wiped |= np.linalg.norm(self._points - place, axis=1) < WIPED_WITHIN_M
        return float(self._wiped.mean())


def readings() -> tuple[Reading, ...]:
    """How much of the pattern is wiped."""
    share = WipedShare()
    return (Reading("wiped_share", share.read, share),)


def add_objects(spec: mujoco.MjSpec, values: Mapping[str, float]) -> tuple[str, ...]:
    """Adds the fixed geom "board" with its bumps, on two legs; no body moves."""
    height, roll, pitch = values["height_m"], 0.5 * values["roll_rad"], 0.5 * values["pitch_rad"]
    turn = np.array(
        [
            np.cos(roll) * np.cos(pitch),
            np.sin(roll) * np.cos(pitch),
            np.cos(roll) * np.sin(pitch),
            -np.sin(roll) * np.sin(pitch),
        ]
    )
    rotation = rotation_from_quaternion(turn)
    top, normal = np.array([CENTER_X_M, 0.0, height]), rotation[:, 2]
    # Above the tool's priority, so that the board's own, lower friction holds.
    surface = {"friction": [values["friction"], 0.005, 0.0001], "priority": 2, "condim": 4, "quat": turn, "rgba": _WHITE}
    box = mujoco.mjtGeom.mjGEOM_BOX
    size = [_HALF_X_M, _HALF_Y_M, _HALF_THICKNESS_M]
    spec.worldbody.add_geom(name="board", type=box, size=size, pos=top - _HALF_THICKNESS_M * normal, **surface)
    swell = max(values["wave_m"], 1e-4)
    sunk = swell if values["wave_m"] > 0.0 else 0.01
    for name, (x, y) in zip(_BUMPS, _BUMP_PLACES_M, strict=True):
        # The upper half of a flat ellipsoid's upper half: it meets the board without a step.
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_ELLIPSOID,
            size=[_BUMP_HALF_M, _BUMP_HALF_M, 2.0 * swell],
            pos=top + rotation @ np.array([x, y, -sunk]),
            **surface,
        )
    spec.worldbody.add_geom(
        name="board_rim",
        type=box,
        size=[_HALF_X_M + 0.012, _HALF_Y_M + 0.012, _HALF_THICKNESS_M],
        pos=top - (_HALF_THICKNESS_M + 0.004) * normal,
        quat=turn,
        contype=0,
        conaffinity=0,
        rgba=[0.36, 0.42, 0.50, 1.0],
    )
    leg_half_height = 0.5 * (height - 0.05)
    for side, y_leg in (("left", _HALF_Y_M - 0.03), ("right", -_HALF_Y_M + 0.03)):
        spec.worldbody.add_geom(
            name=f"board_leg_{side}",
            type=box,
            size=[0.02, 0.02, leg_half_height],
            pos=[CENTER_X_M + _HALF_X_M - 0.03, y_leg, leg_half_height],
            rgba=[0.45, 0.47, 0.50, 1.0],
        )
    return ()
