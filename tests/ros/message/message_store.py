"""What rosbags makes of the robot's messages: a serialiser that others wrote."""

from functools import cache
from types import SimpleNamespace
from typing import Any

import pytest

from tasks.ros.message.definition import definition


def round_trip(kind: str, data: bytes) -> SimpleNamespace:
    """Returns a message as rosbags reads it, which writes the same bytes again."""
    store, full = _store(kind)
    message = store.deserialize_ros1(data, full)
    assert bytes(store.serialize_ros1(message, full)) == data
    return message


@cache
def _store(kind: str) -> tuple[Any, str]:
    types = pytest.importorskip("rosbags.typesys")
    package, name = kind.split("/")
    full = f"{package}/msg/{name}"
    store = types.get_typestore(types.Stores.EMPTY)
    store.register(types.get_types_from_msg(definition(kind), full))
    return store, full
