"""What of the robot touches what, besides its tool and its wheels on the floor; for evaluation."""

from control.joints import END_EFFECTOR_FRAME
from control.timing import CONTROL_PERIOD_S
from sim.backends.simulation.mujoco_backend import MujocoBackend


class Touching:
    """Adds up how long each pair touched.

    Attributes:
        seconds: by "phase: geom on geom".
    """

    def __init__(self, backend: MujocoBackend) -> None:
        model = backend.model
        self._backend = backend
        root = model.body("base").id
        self._names = [model.geom(index).name or str(index) for index in range(model.ngeom)]
        self._robot = model.body_rootid[model.geom_bodyid] == root
        tool = model.body(END_EFFECTOR_FRAME).id
        floor = model.geom("floor").id
        self._tool = model.geom_bodyid == tool
        self._floor = floor
        self.seconds: dict[str, float] = {}

    def look(self, phase: str) -> None:
        """Look once per control period."""
        for pair in self._backend.data.contact.geom:
            if not self._counts(int(pair[0]), int(pair[1])):
                continue
            key = f"{phase}: {' on '.join(sorted(self._names[int(geom)] for geom in pair))}"
            self.seconds[key] = self.seconds.get(key, 0.0) + CONTROL_PERIOD_S

    def _counts(self, first: int, second: int) -> bool:
        ours = bool(self._robot[first]) + bool(self._robot[second])
        if ours == 2:
            return True
        if ours == 0 or self._tool[first] or self._tool[second]:
            return False
        wheel = first if self._robot[first] else second
        return not (self._floor in (first, second) and self._names[wheel].endswith("_wheel"))
