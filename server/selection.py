"""What was selected and the snapshot does not carry."""

from dataclasses import dataclass, field

from sim.backends.simulation.mismatch import Mismatch


@dataclass(frozen=True, slots=True)
class Selection:
    """What the snapshot does not carry: the newest gains and mismatch that were asked for."""

    gains: tuple[float, float] | None = None
    mismatch: Mismatch = field(default_factory=Mismatch)
