"""What the two methods have in common: frames of history in, an action and an estimate of their own out."""

from collections.abc import Mapping
from typing import Protocol

import numpy as np

from control.policy.observation import PAPER_FORM, Observation

OBSERVED = Observation(PAPER_FORM)
"""Frames are made of this observation's parts, at its scales."""

TARGET_SCALES = {
    "base_velocity": 2.0,
    "hand_position": 4.0,
    "anchor": 4.0,
    "force": 0.05,
    "base_force": 0.05,
    "gains": 10.0,
    "friction": 1.0,
}
"""Factor that brings each estimated quantity near one: m/s, m, m, N, N, and shares of nominal for the last two.

The published factors differ from method to method and lean on learning rates for 1e9 samples."""


class Network(Protocol):
    """A method's network, of one robot."""

    def __call__(self, history: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Action (22,) and scaled estimates (targets,), float32, of a history (frames * frame size,), float32, oldest first."""
        ...


class Method(Protocol):
    """A baseline.

    Attributes:
        name: of the controller.
        frames: length of the history.
        frame_size: numbers of a frame.
        targets: sizes of what the estimation head estimates, by name, in order.
    """

    name: str
    frames: int
    frame_size: int
    targets: Mapping[str, int]

    def frame(self, observed: np.ndarray) -> np.ndarray:
        """Frames (n, frame_size), float32, of observations (n, 89) of the paper's form."""
        ...

    def layers(self) -> dict[str, tuple[int, ...]]:
        """Sizes of the networks' layers, by name."""
        ...

    def network(self, arrays: Mapping[str, np.ndarray]) -> Network:
        """The network with these weights: of layer i of the network NAME, "NAME_weight_i" (out, in) and "NAME_bias_i" (out,).

        Raises:
            ValueError: one is missing or has another shape.
        """
        ...


def target_slice(targets: Mapping[str, int], name: str) -> slice:
    """Where an estimated quantity lies among the targets."""
    start = 0
    for known, size in targets.items():
        if known == name:
            return slice(start, start + size)
        start += size
    raise KeyError(name)


def force_estimate(targets: Mapping[str, int], estimates: np.ndarray) -> np.ndarray:
    """Force (..., 3), N, environment on hand, in heading, of scaled estimates (..., targets)."""
    return estimates[..., target_slice(targets, "force")].astype(float) / TARGET_SCALES["force"]


def arrays_of(arrays: Mapping[str, np.ndarray], network: str) -> dict[str, np.ndarray]:
    """The weights of one of the networks, as `control.policy.actor.Actor` names them."""
    prefix = f"{network}_"
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
