"""Reads what a network in ONNX takes, gives and names, without running any of it.

The format is that of Protocol Buffers: https://protobuf.dev/programming-guides/encoding; the numbers of the fields are
those of https://github.com/onnx/onnx/blob/main/onnx/onnx.proto3. Only what decides is looked at: the shapes of inputs
and outputs, the operators, and tensors whose numbers lie in another file.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from tasks.simulate.refusal import RobotRefused

MOST_BYTES = 256 << 20
FLOAT32 = 1
# Graphs inside of nodes inside of graphs.
_DEEPEST = 16
_MOST_NODES = 100_000
_VARINT, _EIGHT_BYTES, _BYTES, _FOUR_BYTES = 0, 1, 2, 5
_LONGEST_VARINT = 70
# Fields of ModelProto, GraphProto, NodeProto, AttributeProto, TensorProto and ValueInfoProto.
_MODEL_GRAPH, _MODEL_FUNCTIONS, _MODEL_TRAINING = 7, 25, 20
_GRAPH_NODE, _GRAPH_INITIALIZER, _GRAPH_INPUT, _GRAPH_OUTPUT, _GRAPH_SPARSE = 1, 5, 11, 12, 15
_FUNCTION_NODE, _FUNCTION_DEFAULT = 7, 11
_NODE_OPERATOR, _NODE_ATTRIBUTE, _NODE_DOMAIN = 4, 5, 7
_ATTRIBUTE_TENSOR, _ATTRIBUTE_GRAPH, _ATTRIBUTE_TENSORS, _ATTRIBUTE_GRAPHS = 5, 6, 10, 11
_ATTRIBUTE_SPARSE = (22, 23)
_TENSOR_NAME, _TENSOR_EXTERNAL, _TENSOR_PLACE = 8, 13, 14
Dimension = int | str | None


class NetworkValue(NamedTuple):
    """An input or output of a network.

    Attributes:
        kind: Its element type as ONNX numbers them; ``FLOAT32`` for float.
        shape: A number, a name, or None where the network leaves open even that; None if it says no shape.
    """

    name: str
    kind: int
    shape: tuple[Dimension, ...] | None


@dataclass
class Network:
    """What is known of a network before it runs.

    Attributes:
        inputs, outputs: In the file's order, inputs without those that the file has numbers for.
        operators: ``(domain, name)`` of each that occurs.
        elsewhere: Names of tensors whose numbers lie in another file.
    """

    inputs: list[NetworkValue] = field(default_factory=list["NetworkValue"])
    outputs: list[NetworkValue] = field(default_factory=list["NetworkValue"])
    operators: set[tuple[str, str]] = field(default_factory=set[tuple[str, str]])
    elsewhere: list[str] = field(default_factory=list[str])
    nodes: int = 0


class _Malformed(Exception):  # noqa: N818 - caught in this module
    """The bytes are no Protocol Buffers."""


def read_network(path: Path, name: str) -> Network:
    """Returns what a network in ONNX takes, gives and names.

    Args:
        path: The file.
        name: Of it, as its author knows it.

    Raises:
        RobotRefused: It is larger than any controller, or no ONNX.
    """
    if path.stat().st_size > MOST_BYTES:
        raise RobotRefused(f"{name}: more than {MOST_BYTES >> 20} MiB: a robot's policy is smaller")
    network = Network()
    try:
        graphs = 0
        for number, value in _fields(memoryview(path.read_bytes())):
            if number == _MODEL_GRAPH:
                graphs += 1
                _read_graph(network, _message(value), 0, outermost=True)
            elif number == _MODEL_FUNCTIONS:
                _read_nodes(network, _message(value), 0, _FUNCTION_NODE)
                for part, default in _fields(_message(value)):
                    if part == _FUNCTION_DEFAULT:
                        _read_attribute(network, _message(default), 0)
            elif number == _MODEL_TRAINING:
                raise RobotRefused(f"{name}: holds a training graph: export the network for inference")
    except (_Malformed, UnicodeDecodeError) as exc:
        raise RobotRefused(f"{name}: is no network in ONNX: {exc}") from exc
    if graphs != 1:
        raise RobotRefused(f"{name}: is no network in ONNX: it has {graphs} graphs")
    return network


def _read_graph(network: Network, graph: memoryview, depth: int, *, outermost: bool) -> None:
    if depth > _DEEPEST:
        raise _Malformed(f"graphs lie more than {_DEEPEST} deep")
    known: set[str] = set()
    for number, value in _fields(graph):
        if number == _GRAPH_INITIALIZER:
            known.add(_read_tensor(network, _message(value)))
        elif number == _GRAPH_SPARSE:
            known.update(_read_sparse(network, _message(value)))
        elif outermost and number in {_GRAPH_INPUT, _GRAPH_OUTPUT}:
            (network.inputs if number == _GRAPH_INPUT else network.outputs).append(_value_info(_message(value)))
    if outermost:
        network.inputs = [each for each in network.inputs if each.name not in known]
    _read_nodes(network, graph, depth, _GRAPH_NODE)


def _read_nodes(network: Network, message: memoryview, depth: int, place: int) -> None:
    for number, node in _fields(message):
        if number != place:
            continue
        network.nodes += 1
        if network.nodes > _MOST_NODES:
            raise _Malformed(f"more than {_MOST_NODES:,} operators")
        operator, domain = "", ""
        for part, value in _fields(_message(node)):
            if part == _NODE_OPERATOR:
                operator = _text(value)
            elif part == _NODE_DOMAIN:
                domain = _text(value)
            elif part == _NODE_ATTRIBUTE:
                _read_attribute(network, _message(value), depth)
        network.operators.add((domain, operator))


def _read_attribute(network: Network, attribute: memoryview, depth: int) -> None:
    for number, value in _fields(attribute):
        if number in {_ATTRIBUTE_GRAPH, _ATTRIBUTE_GRAPHS}:
            _read_graph(network, _message(value), depth + 1, outermost=False)
        elif number in {_ATTRIBUTE_TENSOR, _ATTRIBUTE_TENSORS}:
            _read_tensor(network, _message(value))
        elif number in _ATTRIBUTE_SPARSE:
            _read_sparse(network, _message(value))


def _read_sparse(network: Network, tensor: memoryview) -> list[str]:
    """Returns the names of a sparse tensor's values and indices, which are tensors themselves."""
    return [_read_tensor(network, part) for _, part in _fields(tensor) if isinstance(part, memoryview)]


def _read_tensor(network: Network, tensor: memoryview) -> str:
    """Returns a tensor's name, and notes whether its numbers lie elsewhere."""
    name, elsewhere = "", False
    for number, value in _fields(tensor):
        if number == _TENSOR_NAME:
            name = _text(value)
        elsewhere = elsewhere or number == _TENSOR_EXTERNAL or (number == _TENSOR_PLACE and value == 1)
    if elsewhere:
        network.elsewhere.append(name)
    return name


def _value_info(message: memoryview) -> NetworkValue:
    """Returns a ValueInfoProto: its name, and of its TypeProto the tensor's element type and shape."""
    name, kind, shape = "", 0, None
    for number, value in _fields(message):
        if number == 1:
            name = _text(value)
        for one, tensor in _fields(_message(value)) if number == 2 else ():
            for part, inner in _fields(_message(tensor)) if one == 1 else ():
                if part == 1 and isinstance(inner, int):
                    kind = inner
                elif part == 2:
                    shape = tuple(_dimension(_message(each)) for place, each in _fields(_message(inner)) if place == 1)
    return NetworkValue(name, kind, shape)


def _dimension(message: memoryview) -> Dimension:
    found: Dimension = None
    for number, value in _fields(message):
        if number == 1 and isinstance(value, int):
            found = value
        elif number == 2:
            found = _text(value)
    return found


def _fields(message: memoryview) -> Iterator[tuple[int, int | memoryview]]:
    """Yields the number and the value of each field of a message, those of fixed size without their value."""
    place = 0
    while place < len(message):
        key, place = _varint(message, place)
        number, wire = key >> 3, key & 7
        if wire == _VARINT:
            value, place = _varint(message, place)
            yield number, value
        elif wire == _BYTES:
            size, place = _varint(message, place)
            if size > len(message) - place:
                raise _Malformed("it ends too early")
            yield number, message[place : place + size]
            place += size
        elif wire in {_EIGHT_BYTES, _FOUR_BYTES}:
            place += 8 if wire == _EIGHT_BYTES else 4
        else:
            raise _Malformed(f"a field of wire type {wire}")


def _varint(message: memoryview, place: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, _LONGEST_VARINT, 7):
        if place >= len(message):
            raise _Malformed("it ends too early")
        byte = message[place]
        place += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, place
    raise _Malformed("a number of more than ten bytes")


def _message(value: int | memoryview) -> memoryview:
    if isinstance(value, int):
        raise _Malformed("a number where a message must be")
    return value


def _text(value: int | memoryview) -> str:
    return bytes(_message(value)).decode()
