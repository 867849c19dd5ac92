"""What the base driver needs from a network and what an emulated robot needs: samples as bytes, calls as values.

DdsBaseLink and DdsRobotLink (sim.backends.unitree.dds) speak DDS; sim.emulator.memory_link joins both ends in one process,
with the same bytes, for tests and for machines without cyclonedds.
"""

from typing import Protocol

from sim.backends.unitree.rpc import RpcRequest, RpcResponse


class BaseLink(Protocol):
    """The driver's end. Nothing blocks but `wait`."""

    def send(self, sample: bytes) -> None:
        """Publish a LowCmd_ sample."""
        ...

    def receive(self) -> list[bytes]:
        """LowState_ samples since the last call, oldest first."""
        ...

    def wait(self, timeout_s: float) -> None:
        """Return when a LowState_ sample is there, or after `timeout_s`."""
        ...

    def foreign_frames(self) -> int:
        """LowCmd_ samples of anybody else since the link was opened."""
        ...

    def foreign_writers(self) -> int:
        """Writers of LowCmd_ besides ours on the network now, whether they write or not."""
        ...

    def request(self, request: RpcRequest) -> None:
        """Send a call; its answer comes with `responses`."""
        ...

    def responses(self) -> list[RpcResponse]:
        """Answers since the last call, of any client."""
        ...

    def close(self) -> None:
        """Leave the network."""
        ...


class RobotLink(Protocol):
    """The robot's end, for the emulator."""

    def send(self, sample: bytes) -> None:
        """Publish a LowState_ sample."""
        ...

    def receive(self) -> list[bytes]:
        """LowCmd_ samples since the last call, oldest first."""
        ...

    def wait(self, timeout_s: float) -> None:
        """Return when a LowCmd_ sample or a request is there, or after `timeout_s`."""
        ...

    def requests(self) -> list[RpcRequest]:
        """Calls since the last call."""
        ...

    def respond(self, response: RpcResponse) -> None:
        """Answer a call."""
        ...

    def intrude(self, sample: bytes) -> None:
        """Publish a LowCmd_ sample as a second program would: the "second writer" fault."""

    def close(self) -> None:
        """Leave the network."""
        ...
