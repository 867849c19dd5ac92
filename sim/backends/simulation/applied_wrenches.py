"""The sum of all external wrenches on one simulated world.

Every tick all sources are evaluated at the state of the tick and summed into xfrc_applied, which MuJoCo takes at the
body's centre of mass, so the moment of the application point is added here. Pulses, of which there may be many, are summed by
a kernel (sim.backends.simulation.pulses).
"""

from dataclasses import dataclass

import mujoco
import numpy as np

from control.frames import rotation_heading_to_world
from sim.backends.simulation.pulses import ROW, add_pulses
from sim.backends.simulation.wrenches import BodyState, Pulse, Spring, WrenchSource

MAX_SOURCES = 64


@dataclass(frozen=True)
class ActiveWrench:
    """A source at work: its id, and the simulated time left (inf for an endless one)."""

    id: int
    source: Pulse | WrenchSource
    remaining_s: float


@dataclass(frozen=True)
class _Entry:
    source: Pulse | WrenchSource
    body: int
    start_s: float


class AppliedWrenches:
    """All wrenches that act on one simulated world."""

    STATE = ("_entries", "_next_id", "_drag", "_dragged", "_pushed", "drag_force_in_world", "_others", "_pulses")
    SCRATCH = ("_data", "_velocity")

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._model = model
        self._data = data
        self._base = model.body("base").id
        self._entries: dict[int, _Entry] = {}
        self._next_id = 1
        self._drag: Spring | None = None
        self._dragged = 0
        self._sort()
        self._velocity = np.zeros(6)
        self._pushed = True  # xfrc_applied may not be zero
        self.drag_force_in_world = np.zeros(3)
        """(3,) N, of the drag spring over the last tick."""

    def add(self, source: Pulse | WrenchSource) -> int:
        """Start `source` with the next tick; the id names it in `remove`.

        Raises:
            ValueError: its body is not in the scene (the message lists them), or MAX_SOURCES act already.
        """
        body = self._body_id(source.body)
        if len(self._entries) >= MAX_SOURCES:
            raise ValueError(f"{MAX_SOURCES} wrenches act already; remove one or wait until one expires")
        key = self._next_id
        self._next_id += 1
        self._entries[key] = _Entry(source, body, self._data.time)
        self._sort()
        return key

    def remove(self, key: int) -> None:
        """End one source now. Raises KeyError when it is not at work (never was, expired or removed)."""
        if key not in self._entries:
            raise KeyError(f"wrench {key} is not at work; these are: {sorted(self._entries)}")
        del self._entries[key]
        self._sort()

    @property
    def drag(self) -> Spring | None:
        """The operator's drag spring, if it pulls."""
        return self._drag

    def set_drag(self, spring: Spring | None) -> None:
        """The operator's drag spring, apart from the listed sources: it lives until it is set to None."""
        self._drag = spring
        if spring is None:
            self.drag_force_in_world[:] = 0.0
        else:
            self._dragged = self._body_id(spring.body)

    def clear(self) -> None:
        """End all sources and the drag (a reset sets the simulated time back)."""
        self._entries.clear()
        self._sort()
        self.set_drag(None)

    def list(self) -> tuple[ActiveWrench, ...]:
        """What acts now, oldest first."""
        now = self._data.time
        return tuple(
            ActiveWrench(key, entry.source, entry.source.duration_s - (now - entry.start_s))
            for key, entry in self._entries.items()
        )

    @property
    def acting(self) -> bool:
        """Whether any source or the drag is at work."""
        return bool(self._entries) or self._drag is not None

    def apply(self) -> None:
        """Write the sum of all sources into xfrc_applied for the tick that starts now; expired ones end.

        The kinematics of `data` must be those of the current state where there is any source.
        """
        data = self._data
        if self._pushed:
            data.xfrc_applied[:] = 0.0
        self._pushed = self.acting
        if not self._pushed:
            return
        if self._drag is not None:
            self.drag_force_in_world[:] = self._apply(self._drag, self._dragged, data.time)
        expired = [key for key, entry in self._entries.items() if data.time - entry.start_s >= entry.source.duration_s]
        for key in expired:
            del self._entries[key]
        if expired:
            self._sort()
        if len(self._pulses):
            period_s = self._model.opt.timestep
            add_pulses(self._pulses, data.time, period_s, self._base, data.xmat, data.xpos, data.xipos, data.xfrc_applied)
        for other in self._others:
            self._apply(*other)

    def _sort(self) -> None:
        """The entries by their kinds."""
        rows: list[np.ndarray] = []
        self._others: list[tuple[WrenchSource, int, float]] = []
        for entry in self._entries.values():
            if isinstance(entry.source, Pulse):
                rows.append(entry.source.row(entry.start_s, entry.body))
            else:
                self._others.append((entry.source, entry.body, entry.start_s))
        self._pulses = np.array(rows).reshape(-1, ROW)

    def _apply(self, source: WrenchSource, body: int, start_s: float) -> np.ndarray:
        state = self._state(source, body)
        force, moment = source.wrench(state, self._data.time - start_s)
        x, y, z = state.point - self._data.xipos[body]
        applied = self._data.xfrc_applied[body]
        applied[:3] += force
        applied[3:] += moment
        applied[3] += y * force[2] - z * force[1]
        applied[4] += z * force[0] - x * force[2]
        applied[5] += x * force[1] - y * force[0]
        return force

    def _body_id(self, name: str) -> int:
        bodies = [self._model.body(i).name for i in range(1, self._model.nbody)]
        if name not in bodies:
            raise ValueError(f"body {name!r} is not in the scene; it has {', '.join(bodies)}")
        return self._model.body(name).id

    def _state(self, source: WrenchSource, body: int) -> BodyState:
        data = self._data
        rotation = data.xmat[body].reshape(3, 3)
        offset = rotation @ source.point_m
        # Angular and linear velocity in world axes, of the body frame's origin.
        mujoco.mj_objectVelocity(self._model, data, mujoco.mjtObj.mjOBJ_XBODY, body, self._velocity, 0)
        wx, wy, wz = self._velocity[:3]
        x, y, z = offset
        velocity = self._velocity[3:] + np.array([wy * z - wz * y, wz * x - wx * z, wx * y - wy * x])
        origin = data.xpos[self._base].copy()
        origin[2] = 0.0
        return BodyState(
            time_s=data.time,
            period_s=self._model.opt.timestep,
            point=data.xpos[body] + offset,
            velocity=velocity,
            rotation_body_to_world=rotation,
            rotation_heading_to_world=rotation_heading_to_world(data.xmat[self._base].reshape(3, 3)),
            heading_origin=origin,
        )
