"""Both ends of the base's network in one process, carrying the same bytes as DDS: for lockstep tests without cyclonedds."""

from typing import TypeVar

from sim.backends.unitree.rpc import RpcRequest, RpcResponse

_Item = TypeVar("_Item")


class MemoryWire:
    """What is under way. Make one, then `MemoryBaseLink(wire)` and `MemoryRobotLink(wire)`."""

    def __init__(self) -> None:
        self.states: list[bytes] = []
        self.commands: list[bytes] = []
        self.requests: list[RpcRequest] = []
        self.responses: list[RpcResponse] = []
        self.foreign_frames = 0
        self.foreign_writers = 0
        self.log: list[bytes] = []
        """Every LowCmd_ sample that the driver has sent."""


def _drain(queue: list[_Item]) -> list[_Item]:
    taken = queue[:]
    queue.clear()
    return taken


class MemoryBaseLink:
    """BaseLink of a MemoryWire."""

    def __init__(self, wire: MemoryWire) -> None:
        self._wire = wire

    def send(self, sample: bytes) -> None:
        """Publish a LowCmd_ sample."""
        self._wire.commands.append(sample)
        self._wire.log.append(sample)

    def receive(self) -> list[bytes]:
        """LowState_ samples since the last call."""
        return _drain(self._wire.states)

    def wait(self, timeout_s: float) -> None:
        """Nothing to wait for: the other end runs in the same thread."""

    def foreign_frames(self) -> int:
        """LowCmd_ samples of anybody else so far."""
        return self._wire.foreign_frames

    def foreign_writers(self) -> int:
        """Writers besides ours."""
        return self._wire.foreign_writers

    def request(self, request: RpcRequest) -> None:
        """Send a call."""
        self._wire.requests.append(request)

    def responses(self) -> list[RpcResponse]:
        """Answers since the last call."""
        return _drain(self._wire.responses)

    def close(self) -> None:
        """Nothing to close."""


class MemoryRobotLink:
    """RobotLink of a MemoryWire."""

    def __init__(self, wire: MemoryWire) -> None:
        self._wire = wire

    def send(self, sample: bytes) -> None:
        """Publish a LowState_ sample."""
        self._wire.states.append(sample)

    def receive(self) -> list[bytes]:
        """LowCmd_ samples since the last call."""
        return _drain(self._wire.commands)

    def wait(self, timeout_s: float) -> None:
        """Nothing to wait for: the other end runs in the same thread."""

    def requests(self) -> list[RpcRequest]:
        """Calls since the last call."""
        return _drain(self._wire.requests)

    def respond(self, response: RpcResponse) -> None:
        """Answer a call."""
        self._wire.responses.append(response)

    def intrude(self, sample: bytes) -> None:
        """Publish a LowCmd_ sample as a second program would."""
        self._wire.foreign_writers = 1
        self._wire.foreign_frames += 1
        self._wire.commands.append(sample)

    def close(self) -> None:
        """Nothing to close."""
