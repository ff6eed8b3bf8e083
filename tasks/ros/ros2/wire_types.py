"""ROS 2's interface types as cyclonedds takes them: whole, and as bytes that somebody else wrote.

ROS 2 writes XCDR1 little endian (OMG DDS-XTypes 1.3, section 7.4): a message is written once, for the wire and for
the recording, and goes to DDS as it is.
"""

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from types import new_class
from typing import Any, cast

from cyclonedds.idl import IdlStruct, annotations, types
from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import FieldDesc

from tasks.ros.ros2.interface_types import DEFAULT_DISTRIBUTION, dds_type_name, type_store

_BASE: Mapping[str, Any] = {
    "bool": bool,
    "byte": types.byte,
    "int8": types.int8,
    "uint8": types.uint8,
    "int16": types.int16,
    "uint16": types.uint16,
    "int32": types.int32,
    "uint32": types.uint32,
    "int64": types.int64,
    "uint64": types.uint64,
    "float32": types.float32,
    "float64": types.float64,
    "string": str,
}
# IDL knows no empty structure: rosidl gives one a member of this name.
_NO_FIELDS: list[tuple[str, FieldDesc]] = [("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))]
# What rmw_cyclonedds puts before a request and its reply, to tell whose they are.
_SERVICE_HEADER: Mapping[str, Any] = {"guid": types.uint64, "sequence": types.int64}


class WireBytes(IdlStruct):
    """A sample that is its bytes already: the encapsulation header, then CDR."""

    def __init__(self, cdr: bytes) -> None:
        self.cdr = cdr

    def serialize(self, buffer: object = None, endianness: object = None, use_version_2: object = None) -> bytes:  # noqa: ARG002 - cyclonedds names them
        """Returns the bytes as they are, whatever cyclonedds asks for."""
        return self.cdr

    @classmethod
    def deserialize(cls, data: bytes, has_header: object = True, use_version_2: object = None) -> "WireBytes":  # noqa: ARG003, FBT002
        """Returns a sample that keeps the bytes as they came."""
        return cls(bytes(data))


@functools.cache
def structure(kind: str, distribution: str = DEFAULT_DISTRIBUTION, *, service: bool = False) -> type[IdlStruct]:
    """Returns a type that cyclonedds itself writes and reads.

    Args:
        kind: The type, such as ``sensor_msgs/msg/LaserScan``.
        distribution: The release of ROS 2 whose definition it is.
        service: Put rmw_cyclonedds's header of requests and replies before the fields.
    """
    forms = type_store(distribution).fielddefs[kind][1] or _NO_FIELDS
    annotated = {name: _python_type(form, distribution) for name, form in forms}
    typename = dds_type_name(kind).replace("::", ".")
    name = typename.rpartition(".")[2]
    fields = {**_SERVICE_HEADER, **annotated} if service else annotated
    body = {"__annotations__": fields, "__module__": __name__, "__qualname__": name}
    # The metaclass takes the type's name on the wire when the class is made.
    made = new_class(name, (IdlStruct,), {"typename": typename}, lambda space: space.update(body))
    return annotations.final(dataclass(cast("type[IdlStruct]", made)))


@functools.cache
def wire_type(kind: str, distribution: str = DEFAULT_DISTRIBUTION, *, service: bool = False) -> type[WireBytes]:
    """Returns the same type, its samples as bytes."""
    whole = structure(kind, distribution, service=service)
    made = new_class(whole.__name__, (WireBytes,), {"typename": whole.__idl_typename__})
    made.__idl__ = whole.__idl__
    return cast("type[WireBytes]", made)


def _python_type(form: FieldDesc, distribution: str) -> Any:  # noqa: ANN401 - whatever cyclonedds takes for a field
    node, detail = form
    if node == Nodetype.BASE:
        return _BASE[cast("tuple[str, int]", detail)[0]]
    if node == Nodetype.NAME:
        return structure(cast("str", detail), distribution)
    element, count = cast("tuple[FieldDesc, int]", detail)
    inner = _python_type(element, distribution)
    return types.array[inner, count] if node == Nodetype.ARRAY else types.sequence[inner]
