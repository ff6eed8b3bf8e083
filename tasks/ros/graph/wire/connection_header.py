"""The header that opens a TCPROS connection: fields ``key=value`` (wiki.ros.org/ROS/Connection%20Header)."""

import struct
from collections.abc import Mapping

from tasks.ros.graph.wire import graph_limits as limits

_LENGTH = struct.Struct("<I")


class HeaderError(ValueError):
    """The bytes are no connection header."""


def write_header(fields: Mapping[str, str]) -> bytes:
    """Returns a header with its length before it."""
    parts = [f"{key}={value}".encode() for key, value in fields.items()]
    body = b"".join(_LENGTH.pack(len(part)) + part for part in parts)
    return _LENGTH.pack(len(body)) + body


def take_header(data: bytearray) -> dict[str, str] | None:
    """Returns the header that the bytes begin with, and cuts it off; None while it is not complete.

    Raises:
        HeaderError: If it is longer than a header may be, or no header.
    """
    if len(data) < 4:
        return None
    (length,) = _LENGTH.unpack_from(data)
    if length > limits.HEADER_BYTES:
        raise HeaderError(f"a header of {length} bytes: {limits.HEADER_BYTES} are taken")
    if len(data) < 4 + length:
        return None
    fields = _read_fields(bytes(data[4 : 4 + length]))
    del data[: 4 + length]
    return fields


def _read_fields(data: bytes) -> dict[str, str]:
    fields: dict[str, str] = {}
    at = 0
    while at < len(data):
        if at + 4 > len(data):
            raise HeaderError("a header that ends within a length")
        (length,) = _LENGTH.unpack_from(data, at)
        part = data[at + 4 : at + 4 + length]
        key, equals, value = part.partition(b"=")
        if len(part) != length or not equals:
            raise HeaderError("a header with a field that is not key=value")
        fields[key.decode("utf-8", "replace")] = value.decode("utf-8", "replace")
        at += 4 + length
    return fields
