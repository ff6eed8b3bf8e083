"""Packets on the loopback device, and what DDSI-RTPS 2.5 says that they hold: samples, and endpoints' descriptions."""

import socket
import struct
from collections.abc import Iterator
from typing import NamedTuple, Self

_ETHERNET, _UDP_HEADER, _RTPS_HEADER = 14, 8, 20
_UDP, _IPV4, _ALL = 17, 0x0800, 3
_DATA, _LITTLE, _INLINE_QOS = 0x15, 0x01, 0x02
_SENTINEL = 1
# Table 9.18 and 9.19 of DDSI-RTPS, annex of DDS-XTypes for the last.
PIDS = {
    0x0005: "topic",
    0x0007: "type",
    0x002C: "user_data",
    0x001A: "reliability",
    0x001D: "durability",
    0x0040: "history",
    0x005A: "guid",
    0x0073: "representation",
}
_DESCRIPTIONS = {0x000003C2: "writer", 0x000004C2: "reader", 0x000100C2: "participant"}


class Sample(NamedTuple):
    """A sample: whose it is, and its bytes."""

    guid: bytes
    payload: bytes


class Endpoint(NamedTuple):
    """What a participant, a reader or a writer says of itself."""

    what: str
    parameters: dict[str, bytes]

    def text(self, name: str) -> str:
        """Returns a text: its length, its characters, a zero."""
        data = self.parameters[name]
        (length,) = struct.unpack_from("<I", data)
        return data[4 : 4 + length].rstrip(b"\0").decode()


class Capture:
    """Packets on the loopback device while it is open; needs CAP_NET_RAW.

    Raises:
        PermissionError: The process does not have it.
    """

    def __init__(self) -> None:
        self._socket = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.htons(_ALL))
        self._socket.bind(("lo", 0))
        self._socket.setsockopt(socket.SOL_SOCKET, 33, 1 << 26)  # SO_RCVBUFFORCE
        self._socket.settimeout(0.0)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def samples(self) -> list[Sample]:
        """Returns the samples that have been seen so far, each once."""
        seen: dict[tuple[bytes, bytes, bytes], Sample] = {}
        while True:
            try:
                packet, address = self._socket.recvfrom(1 << 17)
            except BlockingIOError:
                return list(seen.values())
            if address[2] != socket.PACKET_OUTGOING:
                continue
            for number, sample in _samples(packet):
                seen[(sample.guid, number, sample.payload)] = sample


def endpoints(samples: list[Sample]) -> list[Endpoint]:
    """Returns the descriptions among samples."""
    found = [(int.from_bytes(each.guid[12:], "big"), each.payload) for each in samples]
    return [Endpoint(_DESCRIPTIONS[entity], _parameters(data)) for entity, data in found if entity in _DESCRIPTIONS]


def _samples(packet: bytes) -> Iterator[tuple[bytes, Sample]]:
    if int.from_bytes(packet[12:14], "big") != _IPV4 or packet[_ETHERNET + 9] != _UDP:
        return
    at = _ETHERNET + 4 * (packet[_ETHERNET] & 0x0F) + _UDP_HEADER
    if packet[at : at + 4] != b"RTPS":
        return
    prefix, at = packet[at + 8 : at + _RTPS_HEADER], at + _RTPS_HEADER
    while at + 4 <= len(packet):
        kind, flags = packet[at], packet[at + 1]
        length = int.from_bytes(packet[at + 2 : at + 4], "little" if flags & _LITTLE else "big")
        body = packet[at + 4 : at + 4 + length] if length else packet[at + 4 :]
        if kind == _DATA and flags & _LITTLE and not flags & _INLINE_QOS:
            yield body[12:20], Sample(prefix + body[8:12], body[4 + int.from_bytes(body[2:4], "little") :])
        at += 4 + len(body)


def _parameters(payload: bytes) -> dict[str, bytes]:
    found: dict[str, bytes] = {}
    at = 4
    while at + 4 <= len(payload):
        number, length = struct.unpack_from("<HH", payload, at)
        if number == _SENTINEL:
            break
        if number in PIDS:
            found[PIDS[number]] = payload[at + 4 : at + 4 + length]
        at += 4 + length
    return found
