"""Differences between the simulated robot and its nominal model, changeable while it runs. The pipeline is not told."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType

import mujoco
import numpy as np

from control.joints import JOINT_NAMES, LEGS

MASS_SCALE_RANGE = (0.5, 1.5)
FRICTION_SCALE_RANGE = (0.0, 3.0)
PAYLOAD_RANGE_KG = (0.0, 3.0)
PAYLOAD_CENTER_RANGE_M = (-0.3, 0.3)
CARRIER = "end_effector"
"""The body that carries the payload."""


@dataclass(frozen=True)
class Mismatch:
    """Scales of the simulated robot over nominal.

    Attributes:
        mass_scale: mass and inertia of every link, 0.5-1.5 (drive armature is not a link and stays).
        per_link: further scale by body name, 0.5-1.5 each; multiplies `mass_scale`.
        joint_friction_scale: viscous damping and dry friction of all joints, 0-3.
        ground_friction_scale: friction coefficients of the wheels, 0-3.
        payload_kg: mass of a point that the hand carries, 0-3 kg.
        payload_center_m: (3,) where, in the end effector's frame, +-0.3 m.
    """

    mass_scale: float = 1.0
    per_link: Mapping[str, float] = field(default_factory=dict)
    joint_friction_scale: float = 1.0
    ground_friction_scale: float = 1.0
    payload_kg: float = 0.0
    payload_center_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        _check("mass_scale", self.mass_scale, MASS_SCALE_RANGE)
        for link, scale in self.per_link.items():
            _check(f"per_link[{link!r}]", scale, MASS_SCALE_RANGE)
        _check("joint_friction_scale", self.joint_friction_scale, FRICTION_SCALE_RANGE)
        _check("ground_friction_scale", self.ground_friction_scale, FRICTION_SCALE_RANGE)
        _check("payload_kg", self.payload_kg, PAYLOAD_RANGE_KG)
        for axis, value in zip("xyz", self.payload_center_m, strict=True):
            _check(f"payload_center_m, {axis}", value, PAYLOAD_CENTER_RANGE_M)
        object.__setattr__(self, "per_link", MappingProxyType(dict(self.per_link)))


class NominalParameters:
    """The nominal masses and frictions of a model, and how to scale them."""

    def __init__(self, model: mujoco.MjModel, robot_bodies: tuple[str, ...]) -> None:
        """Copies the figures of `robot_bodies` from `model`, which must still be nominal."""
        self._robot_bodies = robot_bodies
        self._bodies = np.array([model.body(name).id for name in robot_bodies])
        self._dofs = np.array([model.joint(name).dofadr[0] for name in JOINT_NAMES])
        self._wheel_geoms = np.array([model.geom(f"{leg}_wheel").id for leg in LEGS])
        self._mass = model.body_mass[self._bodies].copy()
        self._inertia = model.body_inertia[self._bodies].copy()
        self._carrier = model.body(CARRIER).id
        self._center, self._axes = model.body_ipos[self._carrier].copy(), model.body_iquat[self._carrier].copy()
        self._damping = model.dof_damping[self._dofs].copy()
        self._friction = model.dof_frictionloss[self._dofs].copy()
        self._wheel_friction = model.geom_friction[self._wheel_geoms].copy()
        # mj_setConst moves the data it is given to the reference posture: never the running one.
        self._scratch = mujoco.MjData(model)

    def apply(self, model: mujoco.MjModel, mismatch: Mismatch) -> None:
        """Scale `model` from nominal; the running state is not touched.

        Raises:
            ValueError: `per_link` names a body that the robot has not (the message lists them).
        """
        unknown = set(mismatch.per_link) - set(self._robot_bodies)
        if unknown:
            raise ValueError(
                f"per_link names {sorted(unknown)}, which the robot has not; it has {', '.join(self._robot_bodies)}"
            )
        scale = mismatch.mass_scale * np.array([mismatch.per_link.get(name, 1.0) for name in self._robot_bodies])
        model.body_mass[self._bodies] = scale * self._mass
        model.body_inertia[self._bodies] = scale[:, None] * self._inertia
        self._load(model, mismatch.payload_kg, np.array(mismatch.payload_center_m))
        model.dof_damping[self._dofs] = mismatch.joint_friction_scale * self._damping
        model.dof_frictionloss[self._dofs] = mismatch.joint_friction_scale * self._friction
        model.geom_friction[self._wheel_geoms] = mismatch.ground_friction_scale * self._wheel_friction
        mujoco.mj_setConst(model, self._scratch)

    def _load(self, model: mujoco.MjModel, mass_kg: float, center_m: np.ndarray) -> None:
        """Add a point to the carrier, whose own mass and inertia are set already: parallel axes, then principal ones."""
        body = self._carrier
        model.body_ipos[body], model.body_iquat[body] = self._center, self._axes
        if mass_kg == 0.0:
            return
        rotation = np.empty(9)
        mujoco.mju_quat2Mat(rotation, self._axes)
        rotation = rotation.reshape(3, 3)
        own = float(model.body_mass[body])
        middle = (own * self._center + mass_kg * center_m) / (own + mass_kg)
        inertia = rotation * model.body_inertia[body] @ rotation.T
        for mass, point in ((own, self._center), (mass_kg, center_m)):
            arm = point - middle
            inertia += mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
        principal, axes = np.linalg.eigh(inertia)
        axes[:, 2] *= np.linalg.det(axes)
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, axes.ravel())
        model.body_mass[body], model.body_inertia[body] = own + mass_kg, principal
        model.body_ipos[body], model.body_iquat[body] = middle, quaternion

    def total_mass_scale(self, model: mujoco.MjModel) -> float:
        """Mass of the simulated robot over its nominal mass."""
        return float(model.body_mass[self._bodies].sum() / self._mass.sum())


def _check(name: str, value: float, allowed: tuple[float, float]) -> None:
    low, high = allowed
    if not low <= value <= high:
        raise ValueError(f"{name} is {value}; the range is {low} to {high}")
