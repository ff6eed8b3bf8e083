"""Readers and writers of RoboMaker's services: tags of a job, and its end."""

import struct
from collections.abc import Mapping

from pydantic import TypeAdapter, ValidationError

from specs.field_types import TagMap
from tasks.ros.message.stamp import text

REQUEST_BYTES = 64 * 1024
"""A request to one of the robot's services."""
_LENGTH = struct.Struct("<I")
_TAGS: TypeAdapter[dict[str, str]] = TypeAdapter(TagMap)


def read_tags(data: bytes) -> dict[str, str]:
    """Returns the tags of an ``AddTags`` request; of two with one key, the last.

    Raises:
        ValueError: If the bytes are not such a request.
    """
    texts = _read_texts(data, 2)
    return dict(zip(texts[::2], texts[1::2], strict=True))


def read_keys(data: bytes) -> list[str]:
    """Returns the keys of a ``RemoveTags`` request.

    Raises:
        ValueError: If the bytes are not such a request.
    """
    return _read_texts(data, 1)


def write_tags(tags: Mapping[str, str]) -> bytes:
    """Returns a list of tags."""
    parts = [text(key) + text(value) for key, value in tags.items()]
    return b"".join((_LENGTH.pack(len(tags)), *parts))


def joined_tags(tags: Mapping[str, str], more: Mapping[str, str]) -> dict[str, str]:
    """Returns the tags of a job after an application gave it more.

    Raises:
        ValueError: RoboMaker takes no such tags, or not so many; says why.
    """
    try:
        return _TAGS.validate_python({**tags, **more})
    except ValidationError as exc:
        faults = (f"{'.'.join(map(str, each['loc']))}: {each['msg']}" for each in exc.errors()[:5])
        raise ValueError("; ".join(faults)) from exc


def write_outcome(*, success: bool, message: str) -> bytes:
    """Returns what the response of each service begins with, and all of that of ``AddTags`` and ``Cancel``."""
    return struct.pack("<?", success) + text(message)


def _read_texts(data: bytes, each: int) -> list[str]:
    """Returns the texts of a list whose items have so many texts each."""
    if len(data) < 4:
        raise ValueError(f"a list within {len(data)} bytes")
    (count,) = _LENGTH.unpack_from(data)
    texts: list[str] = []
    at = 4
    for _ in range(each * count):
        if at + 4 > len(data):
            raise ValueError(f"a list of {count} that ends after {len(texts) // each}")
        (length,) = _LENGTH.unpack_from(data, at)
        part = data[at + 4 : at + 4 + length]
        if len(part) != length:
            raise ValueError(f"a text of {length} bytes where {len(part)} are left")
        texts.append(part.decode())
        at += 4 + length
    if at != len(data):
        raise ValueError(f"{len(data) - at} bytes after a list of {count}")
    return texts
