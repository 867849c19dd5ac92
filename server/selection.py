"""What was selected and the snapshot does not carry."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Selection:
    """What the snapshot does not carry: the newest gains and mismatch that were asked for."""

    gains: tuple[float, float] | None = None
    mass_scale: float = 1.0
    per_link: Mapping[str, float] | None = None
    payload_kg: float = 0.0
    payload_center_m: Sequence[float] = (0.0, 0.0, 0.0)
