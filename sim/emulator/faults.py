"""Faults on demand: what may go wrong between motors, wire and driver, switched while the emulator runs."""

from collections import deque
from dataclasses import dataclass, fields

import numpy as np

_RANGES = {
    "drop": (0.0, 1.0),
    "delay_s": (0.0, 10.0),
    "jitter_s": (0.0, 10.0),
    "bit_flip": (0.0, 1.0),
    "overheat_rate": (0.0, 1000.0),
    "battery_percent": (-1, 100),
}


@dataclass(slots=True)
class Faults:
    """All off by default. Probabilities are per message and act on states and commands alike.

    Attributes:
        drop: probability that a message is lost.
        delay_s: every state arrives later by this.
        jitter_s: and by up to this more, at random; order is kept.
        bit_flip: probability that one bit of a message is wrong.
        nan: joint whose position reads NaN, under a correct CRC. Empty for none.
        stuck_encoder: joint whose position stays and whose velocity reads zero.
        overheat: joint whose temperature rises.
        overheat_rate: degrees Celsius per second.
        battery_percent: state of charge instead of the true one; negative for the true one.
        second_writer: another program publishes commands too.
        freeze: the robot's board stops: no states, no answers; the motors keep the last command until it times out.
        remote_stop: the operator presses L2 and B on the remote control.
        kill: the emulator ends at once, without a word.
    """

    drop: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0
    bit_flip: float = 0.0
    nan: str = ""
    stuck_encoder: str = ""
    overheat: str = ""
    overheat_rate: float = 5.0
    battery_percent: int = -1
    second_writer: bool = False
    freeze: bool = False
    remote_stop: bool = False
    kill: bool = False

    def update(self, changes: dict[str, object], joints: tuple[str, ...]) -> None:
        """Set fields by name; all or nothing.

        Raises:
            ValueError: a field or a joint is unknown, or a value is of another type or out of range; the message names it.
        """
        known = {field.name: type(getattr(self, field.name)) for field in fields(self)}
        for name, value in changes.items():
            if name not in known:
                raise ValueError(f"no fault {name!r}; there are {', '.join(known)}")
            wanted = known[name]
            sound = isinstance(value, int | float) if wanted is float else isinstance(value, wanted)
            if not sound or (isinstance(value, bool) and wanted is not bool):
                raise ValueError(f"fault {name!r} is {value!r}; it must be {wanted.__name__}")
            if name in _RANGES and not _RANGES[name][0] <= value <= _RANGES[name][1]:  # type: ignore[operator]
                raise ValueError(f"fault {name!r} is {value!r}; it must be {_RANGES[name][0]:g} to {_RANGES[name][1]:g}")
            if wanted is str and value and value not in joints:
                raise ValueError(f"fault {name!r} names {value!r}; the joints are {', '.join(joints)}")
        for name, value in changes.items():
            setattr(self, name, value)


class FaultyChannel:
    """Loses, corrupts and delays the messages of one direction.

    Args:
        faults: read at every message.
        seed: of what is random.
        checksummed: the network itself drops a message with a wrong bit, as it does with the arm's bare datagrams.
    """

    def __init__(self, faults: Faults, seed: int, checksummed: bool = False) -> None:
        self._faults = faults
        self._checksummed = checksummed
        self._random = np.random.default_rng(seed)
        self._queue: deque[tuple[float, bytes]] = deque()

    def corrupt(self, message: bytes) -> bytes | None:
        """The message as it arrives, or None when it is lost."""
        faults = self._faults
        if faults.drop and self._random.random() < faults.drop:
            return None
        if faults.bit_flip and self._random.random() < faults.bit_flip:
            if self._checksummed:
                return None
            wrong = bytearray(message)
            bit = int(self._random.integers(8 * 4, 8 * len(message)))  # behind the encapsulation header
            wrong[bit // 8] ^= 1 << bit % 8
            return bytes(wrong)
        return message

    def delayed(self, message: bytes | None, now: float) -> list[bytes]:
        """Put a message in (None for none) and take out those that are due."""
        faults = self._faults
        if message is not None:
            due = now + faults.delay_s + (faults.jitter_s * self._random.random() if faults.jitter_s else 0.0)
            if self._queue:
                due = max(due, self._queue[-1][0])
            self._queue.append((due, message))
        arrived = []
        while self._queue and self._queue[0][0] <= now:
            arrived.append(self._queue.popleft()[1])
        return arrived
