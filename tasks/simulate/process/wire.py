"""Messages between a run and the process that simulates for it: JSON, and arrays as their bytes.

Nothing is unpickled: the process has run strangers' code, so that its messages are read as data of a known form, and
refused otherwise.
"""

import json
import math
import socket
import struct
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from pydantic import JsonValue

from specs.errors import SimyardError

# Far more than the rows of the largest chunk, or than the samples of one of its slices.
_JSON_BYTES, _ARRAY_BYTES, _ARRAYS = 1 << 30, 1 << 32, 64
_LENGTHS = struct.Struct("<QQ")
_KINDS = "biuf"
Document = Mapping[str, JsonValue]


class MessageRefused(SimyardError):  # noqa: N818 - a state
    """A message is not of the form that messages have."""


class Message(NamedTuple):
    """A message.

    Attributes:
        document: What it says.
        arrays: What goes with it.
    """

    document: dict[str, JsonValue]
    arrays: tuple[np.ndarray, ...] = ()


def send(connection: socket.socket, document: Document | str, arrays: Sequence[np.ndarray] = ()) -> None:
    """Sends a message; returns when the kernel has it.

    Args:
        connection: To the other side.
        document: What it says, or the JSON of that: pydantic writes it in a seventh of the time.
        arrays: What goes with it.

    Raises:
        OSError: The other side is gone.
    """
    whole = [np.asarray(array, order="C") for array in arrays]
    forms = [{"dtype": array.dtype.str, "shape": list(array.shape)} for array in whole]
    said = document if isinstance(document, str) else json.dumps(dict(document), separators=(",", ":"))
    body = f'{{"arrays":{json.dumps(forms)},"document":{said}}}'.encode()
    connection.sendall(_LENGTHS.pack(len(body), sum(array.nbytes for array in whole)) + body)
    for array in whole:
        if array.nbytes:
            connection.sendall(memoryview(array.reshape(-1).view(np.uint8).data))


def receive(connection: socket.socket) -> Message:
    """Returns the next message.

    Raises:
        MessageRefused: It is none.
        EOFError: The other side is gone.
        OSError: It is gone, or says nothing within the connection's timeout.
    """
    json_bytes, array_bytes = _LENGTHS.unpack(_exactly(connection, _LENGTHS.size))
    if json_bytes > _JSON_BYTES or array_bytes > _ARRAY_BYTES:
        raise MessageRefused(f"a message of {json_bytes} and {array_bytes} bytes: at most {_JSON_BYTES}")
    try:
        head = json.loads(_exactly(connection, json_bytes))
        forms = [(np.dtype(form["dtype"]), tuple(int(side) for side in form["shape"])) for form in head["arrays"]]
        document = dict(head["document"])
    except (ValueError, TypeError, KeyError, RecursionError) as exc:
        raise MessageRefused(f"a message that is none: {type(exc).__name__}") from exc
    _check_forms(forms, array_bytes)
    rest = memoryview(_exactly(connection, array_bytes))
    arrays: list[np.ndarray] = []
    for dtype, shape in forms:
        size = math.prod(shape) * dtype.itemsize
        arrays.append(np.frombuffer(rest[:size], dtype).reshape(shape))
        rest = rest[size:]
    return Message(document, tuple(arrays))


def _check_forms(forms: Sequence[tuple[np.dtype, tuple[int, ...]]], array_bytes: int) -> None:
    if len(forms) > _ARRAYS or any(dtype.kind not in _KINDS or min(shape, default=0) < 0 for dtype, shape in forms):
        raise MessageRefused("a message with arrays that are no numbers")
    if sum(math.prod(shape) * dtype.itemsize for dtype, shape in forms) != array_bytes:
        raise MessageRefused("a message whose arrays have other lengths than it says")


def _exactly(connection: socket.socket, length: int) -> bytearray:
    buffer = bytearray(length)
    view, done = memoryview(buffer), 0
    while done < length:
        count = connection.recv_into(view[done:], min(length - done, 1 << 20))
        if not count:
            raise EOFError("the other side is gone")
        done += count
    return buffer
