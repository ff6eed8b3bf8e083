"""A DDS domain for an episode: a number, loopback only, and what ROS 2's nodes are told of it.

Sources: ROS 2's documentation, "The ROS_DOMAIN_ID"; Cyclone DDS's guide to its configuration; Fast DDS's documentation,
"XML profiles"; rmw_fastrtps_cpp, which reads them. DDSI-RTPS 2.5, section 9.6.2.4, for ports.
"""

import contextlib
import errno
import itertools
import os
import secrets
import socket
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import NamedTuple, Protocol

CYCLONE, FAST = "rmw_cyclonedds_cpp", "rmw_fastrtps_cpp"
MIDDLEWARES = (CYCLONE, FAST)
"""What nodes may speak for the robot to understand them, the better first."""

# The domains whose ports lie below those that Linux gives out by itself.
DOMAINS = range(102)
# Participants, one a process: each is looked for at this many ports.
_PARTICIPANTS = 60
# A scan goes out whole: the largest UDP datagram, less headers.
_DATAGRAM_BYTES, _FRAGMENT_BYTES = 65_500, 65_000
_FIRST_PORT, _PORTS_A_DOMAIN, _PORT_OF_FIRST = 7400, 250, 10
# Of a domain's ports one that no participant uses (DDSI-RTPS 2.5, 9.6.2.4: 0, 1, and two each from 10 on).
_PORT_OF_LOCK = 5
# How long another run's episodes are waited for, and how often it is looked.
_WAIT_S, _AGAIN_S = 1800.0, 0.5

# How soon a writer asks whether all has come; lock-step waits for the answer.
_HEARTBEAT = "1ms"
# How often a participant says that it is there: the first time may be too early for who shall hear it.
_AGAIN = "1s"
_PROFILE = "fastdds.xml"
# The same of Fast DDS. Its readers say first that they have nothing, again and again until they are answered.
_BEAT_NS, _FIRST_ACK_NS = 20_000_000, 1_000_000
# How often its participants say that they are there, 3 s by default; they are forgotten after 20 s of silence.
_SAYS_S = 8
# Names of one process's participants with peers of their own; Cyclone DDS has one configuration for each.
_numbers = itertools.count(1000)


class DomainPlace(Protocol):
    """Where a participant lives."""

    @property
    def number(self) -> int:
        """Returns this process's own number for it."""
        ...

    @property
    def uri(self) -> str:
        """Returns its CYCLONEDDS_URI."""
        ...


class LinkPlace(NamedTuple):
    """Where a participant lives that only one other one hears of; see ``DomainPlace``."""

    number: int
    uri: str


class EpisodeDomain(NamedTuple):
    """Where an episode's nodes and its robot meet, and nobody else.

    Attributes:
        number: The ROS_DOMAIN_ID.
        tag: Participants of other tags do not see these, in the same domain or not; nobody can guess it. Fast DDS knows
            none: it is empty there, and other processes are kept away by the number alone.
        middleware: What the nodes speak.
        held: Keeps other processes of Simyard from the number.
    """

    number: int
    tag: str
    middleware: str = CYCLONE
    held: socket.socket | None = None

    @property
    def uri(self) -> str:
        """Returns the CYCLONEDDS_URI: interfaces, discovery without multicast, whole scans in a datagram."""
        index = f"<ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>{_PARTICIPANTS}"
        return self._uri(f"{index}</MaxAutoParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers>")

    def link(self, addresses: Iterable[str]) -> LinkPlace:
        """Returns where a participant lives that only one other one hears of.

        Args:
            addresses: Where that one listens.
        """
        peers = "".join(f"<Peer address='{each}'/>" for each in addresses)
        found = f"<ExternalDomainId>{self.number}</ExternalDomainId><ParticipantIndex>none</ParticipantIndex>"
        found += f"<SPDPInterval>{_AGAIN}</SPDPInterval><Peers AddLocalhost='false'>{peers}</Peers>"
        return LinkPlace(next(_numbers), self._uri(found))

    def _uri(self, discovery: str) -> str:
        tag = f"<Tag>{self.tag}</Tag>" if self.tag else ""
        return (
            "<CycloneDDS><Domain id='any'><General>"
            "<Interfaces><NetworkInterface address='127.0.0.1' multicast='false'/></Interfaces>"
            "<AllowMulticast>false</AllowMulticast>"
            f"<MaxMessageSize>{_DATAGRAM_BYTES}B</MaxMessageSize><FragmentSize>{_FRAGMENT_BYTES}B</FragmentSize>"
            f"</General><Discovery>{discovery}{tag}</Discovery><Internal>"
            f"<HeartbeatInterval min='{_HEARTBEAT}' minsched='{_HEARTBEAT}'>{_HEARTBEAT}</HeartbeatInterval>"
            "<AckDelay>0ms</AckDelay></Internal></Domain></CycloneDDS>"
        )

    def environment(self, folder: Path, fast_dds: int = 2) -> Mapping[str, str]:
        """Returns what ROS 2's nodes see: this domain, on this machine alone.

        Args:
            folder: Where Fast DDS's profile is written to.
            fast_dds: Its major version.
        """
        own = {"ROS_DOMAIN_ID": str(self.number), "RMW_IMPLEMENTATION": self.middleware}
        # Since Iron: leave to the middleware's own configuration who is looked for, which says loopback.
        own["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "SYSTEM_DEFAULT"
        if self.middleware == CYCLONE:
            return {**own, "CYCLONEDDS_URI": self.uri}
        path = folder / _PROFILE
        path.write_text(fast_dds_profile(fast_dds))
        return {**own, "FASTRTPS_DEFAULT_PROFILES_FILE": str(path), "FASTDDS_DEFAULT_PROFILES_FILE": str(path)}

    def close(self) -> None:
        """Leaves the number to others."""
        if self.held is not None:
            self.held.close()


def fast_dds_profile(version: int) -> str:
    """Returns the XML profile of Fast DDS: the same interface and peers, over UDP alone, answers without a delay.

    A participant that is killed leaves its shared memory behind, so there is none. Readers answer heartbeats at once,
    and writers requests: both wait 5 ms by default, and lock-step waits for the answer. A writer tells of what nobody
    has acknowledged each 3 s by default: so long a process would wait at its start, for the robot answers nothing else.

    Args:
        version: 2 or 3: each ignores the whole file for a name that it does not know, and then listens everywhere.
    """
    ack, beat, nack, period = "initialAcknackDelay", "heartbeatResponseDelay", "nackResponseDelay", "heartbeatPeriod"
    says = f"<discovery_config><leaseAnnouncement><sec>{_SAYS_S}</sec></leaseAnnouncement></discovery_config>"
    untold = ""
    if version > 2:
        ack, beat, nack = "initial_acknack_delay", "heartbeat_response_delay", "nack_response_delay"
        period = "heartbeat_period"
        # What it tells of types makes Cyclone DDS refuse those with sequences.
        untold = (
            "<propertiesPolicy><properties><property><name>fastdds.type_propagation</name><value>disabled</value>"
            "</property></properties></propertiesPolicy>"
        )
    place = "<locator><udpv4><address>127.0.0.1</address></udpv4></locator>"
    return (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">'
        "<transport_descriptors><transport_descriptor><transport_id>loopback</transport_id><type>UDPv4</type>"
        "<sendBufferSize>1048576</sendBufferSize><receiveBufferSize>4194304</receiveBufferSize>"
        f"<maxInitialPeersRange>{_PARTICIPANTS}</maxInitialPeersRange>"
        "<interfaceWhiteList><address>127.0.0.1</address></interfaceWhiteList>"
        "</transport_descriptor></transport_descriptors>"
        '<participant profile_name="simyard" is_default_profile="true"><rtps>'
        "<userTransports><transport_id>loopback</transport_id></userTransports>"
        "<useBuiltinTransports>false</useBuiltinTransports>"
        f"<defaultUnicastLocatorList>{place}</defaultUnicastLocatorList>"
        f"<builtin>{says}<metatrafficUnicastLocatorList>{place}</metatrafficUnicastLocatorList>"
        f"<initialPeersList>{place}</initialPeersList></builtin>{untold}</rtps></participant>"
        '<data_reader profile_name="at_once_reader" is_default_profile="true">'
        f"<times><{ack}><nanosec>{_FIRST_ACK_NS}</nanosec></{ack}><{beat}><nanosec>0</nanosec></{beat}></times></data_reader>"
        '<data_writer profile_name="at_once_writer" is_default_profile="true">'
        f"<times><{period}><nanosec>{_BEAT_NS}</nanosec></{period}><{nack}><nanosec>0</nanosec></{nack}></times>"
        "</data_writer>"
        "</profiles>"
    )


def domain_of(port: int) -> int | None:
    """Returns the domain whose participants receive at a port; None for any other port."""
    number, place = divmod(port - _FIRST_PORT, _PORTS_A_DOMAIN)
    return number if number in DOMAINS and place < _PORT_OF_FIRST + 2 * (_PARTICIPANTS + 1) else None


def episode_domains(count: int, middleware: str = CYCLONE) -> list[EpisodeDomain]:
    """Returns a domain for each of so many episodes, which no other process of Simyard on this network has.

    Numbers that somebody else's participants use are left out. Where another run has so many that too few are left, its
    end is waited for, without holding any. Whoever asks closes what it gets.

    Args:
        count: How many.
        middleware: What their nodes speak.

    Raises:
        OSError: More episodes than there are domains, or than get free in half an hour: fewer may fit (``NO_ROOM``).
    """
    ends_s = time.monotonic() + (_WAIT_S if count <= len(DOMAINS) else 0.0)
    while True:
        found = _free_domains(count, middleware)
        if len(found) == count:
            return found
        for each in found:
            each.close()
        if time.monotonic() >= ends_s:
            raise OSError(
                errno.EAGAIN,
                f"{count} episodes at once, and {len(found)} of DDS's {len(DOMAINS)} domains for ROS 2 are free here: "
                "simulate fewer lanes in a chunk",
            )
        time.sleep(_AGAIN_S)


def _free_domains(count: int, middleware: str) -> list[EpisodeDomain]:
    """Returns so many domains, or all that are free."""
    first, found = os.getpid() % len(DOMAINS), list[EpisodeDomain]()
    for number in itertools.islice(itertools.cycle(DOMAINS), first, first + len(DOMAINS)):
        if len(found) == count:
            break
        if held := _held(number):
            tag = f"simyard-{secrets.token_hex(12)}" if middleware == CYCLONE else ""
            found.append(EpisodeDomain(number, tag, middleware, held))
    return found


def _held(number: int) -> socket.socket | None:
    """Returns what keeps a number from other processes; None if one has it.

    The kernel gives a port to one process of a network, and takes it back when that ends.
    """
    first = _FIRST_PORT + _PORTS_A_DOMAIN * number
    held = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        held.bind(("127.0.0.1", first + _PORT_OF_LOCK))
        with contextlib.closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as taken:
            taken.bind(("127.0.0.1", first + _PORT_OF_FIRST))
    except OSError as exc:
        held.close()
        if exc.errno != errno.EADDRINUSE:
            raise
        return None
    return held
