"""Both ends of the base's network over DDS (cyclonedds 11.0.1): the driver's and, for the emulator, the robot's.

Safe by default: domain 1 on the loopback interface. The robot lives on domain 0 behind a cable, and anything sent there
moves it, so domain 0 and any other interface need an explicit `allow_robot`.

Do not fork a process that holds a participant: its threads do not survive the fork. Spawn instead.
"""

import re
from dataclasses import dataclass
from importlib import metadata
from typing import Any

from sim.backends.protocol import BackendError
from sim.backends.unitree.rpc import SERVICES, RpcRequest, RpcResponse

COMMAND_TOPIC = "rt/lowcmd"
STATE_TOPIC = "rt/lowstate"
LOOPBACK = "lo"
DEPTH = 16
"""Samples kept for a reader that is late; newer ones push out older ones."""

VERSION = "11.0.1"
INSTALL_HINT = f"the hardware backend needs cyclonedds {VERSION}: pip install 'forcelens[hardware]'"


class RobotNetworkError(BackendError):
    """The network of a real robot was named without saying that this is meant."""


@dataclass(frozen=True, slots=True)
class DdsConfig:
    """Where the base is.

    Attributes:
        domain: DDS domain; 0 is the robot's.
        interface: network interface that leads to it.
        allow_robot: explicit consent to domain 0 or an interface other than loopback.
        multicast: discover peers by multicast, as the vendor's software does; on loopback the interface must permit it
            (`ip link set lo multicast on`).
    """

    domain: int = 1
    interface: str = LOOPBACK
    allow_robot: bool = False
    multicast: bool = False

    def __post_init__(self) -> None:
        if not 0 <= self.domain <= 230:
            raise ValueError(f"DDS domain is {self.domain}; it must be 0 to 230")
        if not re.fullmatch(r"[\w.:-]{1,32}", self.interface):
            raise ValueError(f"{self.interface!r} is not the name of a network interface")
        if (self.domain == 0 or self.interface != LOOPBACK) and not self.allow_robot:
            raise RobotNetworkError(
                f"domain {self.domain} on {self.interface!r} may reach a real robot; say so explicitly (allow_robot, "
                f"--allow-robot), or use domain 1 on 'lo'"
            )

    @property
    def xml(self) -> str:
        """Cyclone's configuration for this network."""
        interface = f'<NetworkInterface name="{self.interface}" priority="default" multicast="{{}}"/>'
        if self.interface != LOOPBACK or self.multicast:
            multicast = "true" if self.interface == LOOPBACK else "default"
            general = f"<General><Interfaces>{interface.format(multicast)}</Interfaces></General>"
            return f'<CycloneDDS><Domain Id="any">{general}</Domain></CycloneDDS>'
        general = (
            f"<General><Interfaces>{interface.format('default')}</Interfaces><AllowMulticast>false</AllowMulticast></General>"
        )
        discovery = (
            "<Discovery><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>20</MaxAutoParticipantIndex>"
            '<Peers><Peer address="127.0.0.1"/></Peers></Discovery>'
        )
        return f'<CycloneDDS><Domain Id="any">{general}{discovery}</Domain></CycloneDDS>'


def dds_unavailable_because() -> str | None:
    """Why DDS cannot be used here, None when it can.

    Another version may hash the types differently, which kills processes on the robot (sim.backends.unitree.idl).
    """
    try:
        installed = metadata.version("cyclonedds")
    except metadata.PackageNotFoundError:
        return INSTALL_HINT
    return None if installed == VERSION else f"{INSTALL_HINT} (found {installed})"


_domains: dict[int, tuple[str, Any]] = {}


def _participant(config: DdsConfig) -> Any:
    """A participant on the configured network. A process configures each domain once.

    Raises:
        BackendError: cyclonedds is missing or of another version, the interface does not exist, or this process already uses
            the domain with another configuration.
    """
    reason = dds_unavailable_because()
    if reason is not None:
        raise BackendError(reason)
    from cyclonedds.core import DDSException
    from cyclonedds.domain import Domain, DomainParticipant

    xml, _ = _domains.get(config.domain, (config.xml, None))
    if xml != config.xml:
        raise BackendError(f"this process already uses DDS domain {config.domain} with another configuration")
    try:
        if config.domain not in _domains:
            _domains[config.domain] = (config.xml, Domain(config.domain, config.xml))
        return DomainParticipant(config.domain)
    except DDSException as error:
        raise BackendError(
            f"no DDS on interface {config.interface!r}, domain {config.domain} ({error}); is the interface up?"
        ) from error


class Endpoint:
    """One participant with its readers and writers, and a wait set over those readers that wake. Raises as DdsBaseLink."""

    def __init__(self, config: DdsConfig) -> None:
        self._participant = _participant(config)
        from cyclonedds.core import WaitSet

        self._waitset = WaitSet(self._participant)
        self._conditions: list[Any] = []
        self._topics: dict[str, Any] = {}

    def topic(self, name: str, kind: type) -> Any:
        """The topic, made once."""
        from cyclonedds.topic import Topic

        if name not in self._topics:
            self._topics[name] = Topic(self._participant, name, kind)
        return self._topics[name]

    def writer(self, name: str, kind: type) -> Any:
        """A writer with the vendor's (default) quality of service: XCDR1, reliable, newest sample."""
        from cyclonedds.pub import DataWriter

        return DataWriter(self._participant, self.topic(name, kind))

    def reader(self, name: str, kind: type, *, wakes: bool = False, reliable: bool = False, foreign: bool = False) -> Any:
        """A reader of the last DEPTH samples; `foreign` ones of other participants only."""
        from cyclonedds.core import InstanceState, ReadCondition, SampleState, ViewState
        from cyclonedds.qos import Policy, Qos
        from cyclonedds.sub import DataReader
        from cyclonedds.util import duration

        policies: list[Any] = [Policy.History.KeepLast(DEPTH)]
        if reliable:
            policies.append(Policy.Reliability.Reliable(duration(seconds=1)))
        if foreign:
            policies.append(Policy.IgnoreLocal.Participant)
        reader = DataReader(self._participant, self.topic(name, kind), Qos(*policies))
        if wakes:
            condition = ReadCondition(reader, SampleState.NotRead | ViewState.Any | InstanceState.Any)
            self._waitset.attach(condition)
            self._conditions.append(condition)
        return reader

    def wait(self, timeout_s: float) -> None:
        """Until a reader that wakes has something new, or `timeout_s` is over."""
        self._waitset.wait(max(0, int(timeout_s * 1e9)))

    def close(self) -> None:
        """Leave at once: peers see it immediately instead of after the lease of 10 s."""
        self._participant._delete(self._participant._ref)


def samples(reader: Any) -> list[bytes]:
    """Bytes of the raw samples that a reader holds, oldest first, taken."""
    # A peer that leaves yields samples without data.
    return [sample.data for sample in reader.take(DEPTH) if sample.sample_info.valid_data]


class DdsBaseLink:
    """BaseLink over DDS.

    Raises:
        BackendError: cyclonedds is not installed, or the network cannot be used.
    """

    def __init__(self, config: DdsConfig) -> None:
        endpoint = self._endpoint = Endpoint(config)
        from sim.backends.unitree.idl import LowCmd_, LowState_, Request_, Response_, make_request

        self._sample: Any = LowCmd_
        self._make_request = make_request
        self._writer = endpoint.writer(COMMAND_TOPIC, LowCmd_)
        self._states = endpoint.reader(STATE_TOPIC, LowState_, wakes=True)
        self._foreign = endpoint.reader(COMMAND_TOPIC, LowCmd_, foreign=True)
        self._foreign_frames = 0
        self._requests = {name: endpoint.writer(f"rt/api/{name}/request", Request_) for name in SERVICES}
        self._responses = {name: endpoint.reader(f"rt/api/{name}/response", Response_, reliable=True) for name in SERVICES}

    def send(self, sample: bytes) -> None:
        """Publish a LowCmd_ sample."""
        self._writer.write(self._sample(sample))

    def receive(self) -> list[bytes]:
        """LowState_ samples since the last call, oldest first."""
        return samples(self._states)

    def wait(self, timeout_s: float) -> None:
        """Return when a LowState_ sample is there, or after `timeout_s`."""
        self._endpoint.wait(timeout_s)

    def foreign_frames(self) -> int:
        """LowCmd_ samples of anybody else since the link was opened."""
        self._foreign_frames += len(samples(self._foreign))
        return self._foreign_frames

    def foreign_writers(self) -> int:
        """Writers of LowCmd_ besides ours on the network now."""
        return len(self._foreign.get_matched_publications())

    def request(self, request: RpcRequest) -> None:
        """Send a call."""
        self._requests[request.service].write(self._make_request(request.id, request.api_id, request.parameter))

    def responses(self) -> list[RpcResponse]:
        """Answers since the last call."""
        return [
            RpcResponse(name, answer.header.identity.id, answer.header.identity.api_id, answer.header.status.code, answer.data)
            for name, reader in self._responses.items()
            for answer in reader.take(DEPTH)
            if answer.sample_info.valid_data
        ]

    def close(self) -> None:
        """Leave the network."""
        self._endpoint.close()


class DdsRobotLink:
    """RobotLink over DDS.

    Raises:
        BackendError: cyclonedds is not installed, or the network cannot be used.
    """

    def __init__(self, config: DdsConfig) -> None:
        endpoint = self._endpoint = Endpoint(config)
        from sim.backends.unitree.idl import LowCmd_, LowState_, Request_, Response_, make_response

        self._config = config
        self._sample: Any = LowState_
        self._command_sample: Any = LowCmd_
        self._make_response = make_response
        self._writer = endpoint.writer(STATE_TOPIC, LowState_)
        self._commands = endpoint.reader(COMMAND_TOPIC, LowCmd_, wakes=True)
        self._requests = {
            name: endpoint.reader(f"rt/api/{name}/request", Request_, wakes=True, reliable=True) for name in SERVICES
        }
        self._responses = {name: endpoint.writer(f"rt/api/{name}/response", Response_) for name in SERVICES}
        self._intruder: Any = None

    def send(self, sample: bytes) -> None:
        """Publish a LowState_ sample."""
        self._writer.write(self._sample(sample))

    def receive(self) -> list[bytes]:
        """LowCmd_ samples since the last call, oldest first."""
        return samples(self._commands)

    def wait(self, timeout_s: float) -> None:
        """Return when a LowCmd_ sample or a request is there, or after `timeout_s`."""
        self._endpoint.wait(timeout_s)

    def requests(self) -> list[RpcRequest]:
        """Calls since the last call."""
        return [
            RpcRequest(name, call.header.identity.id, call.header.identity.api_id, call.parameter)
            for name, reader in self._requests.items()
            for call in reader.take(DEPTH)
            if call.sample_info.valid_data
        ]

    def respond(self, response: RpcResponse) -> None:
        """Answer a call."""
        sample = self._make_response(response.id, response.api_id, response.code, response.data)
        self._responses[response.service].write(sample)

    def intrude(self, sample: bytes) -> None:
        """Publish a LowCmd_ sample as a second program would, from a participant of its own."""
        if self._intruder is None:
            endpoint = Endpoint(self._config)
            self._intruder = (endpoint, endpoint.writer(COMMAND_TOPIC, self._command_sample))
        self._intruder[1].write(self._command_sample(sample))

    def close(self) -> None:
        """Leave the network."""
        if self._intruder is not None:
            self._intruder[0].close()
        self._endpoint.close()
