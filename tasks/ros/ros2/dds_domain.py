"""A DDS domain for an episode: a number, a tag, loopback only; what ROS 2's nodes are told of it."""

import itertools
import os
import secrets
from collections.abc import Mapping
from typing import NamedTuple

# The domains whose ports lie below those that Linux gives out by itself (ROS 2's documentation, "The ROS_DOMAIN_ID").
DOMAINS = range(102)
# Participants, one a process: each is looked for at this many ports.
_PARTICIPANTS = 60
# A scan goes out whole: the largest UDP datagram, less headers.
_DATAGRAM_BYTES, _FRAGMENT_BYTES = 65_500, 65_000

# How soon a writer asks whether all has come; lock-step waits for the answer.
_HEARTBEAT = "1ms"


class EpisodeDomain(NamedTuple):
    """Where an episode's nodes and its robot meet, and nobody else.

    Attributes:
        number: The ROS_DOMAIN_ID.
        tag: Participants of other tags do not see these, in the same domain or not; nobody can guess it.
    """

    number: int
    tag: str

    @property
    def uri(self) -> str:
        """Returns the CYCLONEDDS_URI: interfaces, discovery without multicast, whole scans in a datagram."""
        return (
            "<CycloneDDS><Domain id='any'><General>"
            "<Interfaces><NetworkInterface address='127.0.0.1' multicast='false'/></Interfaces>"
            "<AllowMulticast>false</AllowMulticast>"
            f"<MaxMessageSize>{_DATAGRAM_BYTES}B</MaxMessageSize><FragmentSize>{_FRAGMENT_BYTES}B</FragmentSize>"
            "</General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>{_PARTICIPANTS}</MaxAutoParticipantIndex>"
            f"<Peers><Peer address='127.0.0.1'/></Peers><Tag>{self.tag}</Tag></Discovery><Internal>"
            f"<HeartbeatInterval min='{_HEARTBEAT}' minsched='{_HEARTBEAT}'>{_HEARTBEAT}</HeartbeatInterval>"
            "<AckDelay>0ms</AckDelay></Internal></Domain></CycloneDDS>"
        )

    @property
    def environment(self) -> Mapping[str, str]:
        """Returns what ROS 2's nodes see: this domain, over Cyclone DDS, on this machine alone."""
        return {
            "ROS_DOMAIN_ID": str(self.number),
            "RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp",
            "CYCLONEDDS_URI": self.uri,
            # Since Iron: leave to CYCLONEDDS_URI who is looked for, which says loopback.
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",
        }


def episode_domains(count: int) -> list[EpisodeDomain]:
    """Returns a domain for each of so many episodes of this process.

    A process has one configuration for a domain, so the numbers differ; tags keep episodes of other processes apart.

    Raises:
        ValueError: More episodes than there are domains.
    """
    if count > len(DOMAINS):
        raise ValueError(
            f"{count} episodes at once, and DDS has {len(DOMAINS)} domains for ROS 2: simulate fewer lanes in a chunk"
        )
    first = os.getpid() % len(DOMAINS)
    numbers = itertools.islice(itertools.cycle(DOMAINS), first, first + count)
    return [EpisodeDomain(number, f"simyard-{secrets.token_hex(12)}") for number in numbers]
