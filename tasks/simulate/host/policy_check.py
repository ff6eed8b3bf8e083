"""Holds a policy's declaration against its network, before anything of it runs: all that is wrong is said at once.

What a network in ONNX takes, gives and names is read without running any of it.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from specs.bundle_files import ChoiceOutput, Policy, PolicyInput
from tasks.simulate.application.mjcf_check import RobotRefused
from tasks.simulate.host.declaration import ROBOT_FILE, read_declaration

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


# The format is that of Protocol Buffers: https://protobuf.dev/programming-guides/encoding; the numbers of the fields
# are those of https://github.com/onnx/onnx/blob/main/onnx/onnx.proto3. Only what decides is looked at: the shapes of
# inputs and outputs, the operators, and tensors whose numbers lie in another file.
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


# Those of onnxruntime itself; of any other domain they come in a library, which is never loaded.
_DOMAINS = {"", "ai.onnx", "ai.onnx.ml", "com.microsoft"}
_RANDOM = {"Bernoulli", "Multinomial", "RandomNormal", "RandomNormalLike", "RandomUniform", "RandomUniformLike"}
_FIXED_SIZES: Mapping[str, int] = {
    "goal_robot_m": 2,
    "goal_m": 2,
    "goal_index": 1,
    "pose": 3,
    "velocity": 3,
    "time_s": 1,
}


class RobotNumbers(NamedTuple):
    """How many numbers a robot has.

    Attributes:
        actuators: Of a control.
        ranged: Actuators that have a ``ctrlrange``.
        qpos, qvel: Coordinates and speeds of all that moves; 0 for a robot that is no more than a planar base.
    """

    actuators: int
    ranged: int
    qpos: int
    qvel: int


class CheckedPolicy(NamedTuple):
    """A policy that fits its network.

    Attributes:
        path: The network.
        policy: Its declaration, with every name filled in.
        state_shapes: What the network keeps, in the declaration's order; None where the lanes are.
        input_shapes: What it is shown of one lane.
    """

    path: Path
    policy: Policy
    state_shapes: tuple[tuple[int | None, ...], ...]
    input_shapes: tuple[tuple[int, ...], ...]


def check_policy(folder: Path, name: str, robot: RobotNumbers | None = None) -> CheckedPolicy:
    """Returns the policy of a network.

    Args:
        folder: Where its bundle is unpacked.
        name: The network's file in it (``specs.launched_file.policy_file``).
        robot: What the robot has; None if that is not looked at.

    Raises:
        RobotRefused: The network or its declaration is not what it must be, or one does not fit the other.
    """
    path, declared = folder / name, f"{name.removesuffix('.onnx')}.yaml"
    if not path.resolve().is_relative_to(folder.resolve()):
        raise RobotRefused(f"{name}: leads out of the bundle")
    policy = read_declaration(folder / declared, declared, Policy, folder / ROBOT_FILE)
    if policy is None:
        raise RobotRefused(f"{declared}: is missing: it says what {name} is shown (docs/guide/policies.md)")
    network = read_network(path, name)
    faults = [f"{name}: {fault}" for fault in _network_faults(network)]
    policy = _named(policy, network)
    faults += [f"{declared}: {fault}" for fault in _fit_faults(policy, network, robot)]
    if faults:
        raise RobotRefused("; ".join(dict.fromkeys(faults)))
    values = {value.name: value for value in network.inputs}
    return CheckedPolicy(
        path=path,
        policy=policy,
        state_shapes=tuple(
            tuple(size if isinstance(size, int) else None for size in values[each.input].shape or ())
            for each in policy.states
        ),
        input_shapes=tuple(
            _lane_shape(values[each.name or ""].shape or (), part_numbers(policy, each, robot))
            for each in policy.inputs
        ),
    )


def part_numbers(policy: Policy, shown: PolicyInput, robot: RobotNumbers | None) -> int | None:
    """Returns how many numbers an input is shown of a lane; None if that needs the robot, which is not looked at."""
    sizes = _sizes(policy, robot)
    counts = [(sizes.get(part.field), part.frames) for part in shown.parts]
    return None if any(size is None for size, _ in counts) else sum((size or 0) * frames for size, frames in counts)


# Of each field: the sensor that it comes from, and how many numbers it has for what is declared of that.
_OF_SENSORS: Mapping[str, tuple[str, Callable[[Any], int]]] = {
    "ranges_m": ("lidar", lambda lidar: lidar.rays),
    "bumper": ("bumper", lambda bumper: bumper.sectors),
    "depth_m": ("depth_camera", lambda camera: math.prod(camera.shape)),
    "finder_m": ("range_finders", lambda finders: finders.finders),
    "turn_rad_s": ("imu", lambda _: 3),
    "force_m_s2": ("imu", lambda _: 3),
    "ticks": ("wheel_encoders", lambda _: 2),
    "field_ut": ("compass", lambda _: 3),
    "cliff_m": ("cliff_sensors", lambda cliffs: cliffs.sensors),
    "gps_m": ("gps", lambda _: 3),
    "color": ("color_camera", lambda camera: 3 * math.prod(camera.shape)),
}


def _sizes(policy: Policy, robot: RobotNumbers | None) -> dict[str, int | None]:
    return {
        **_FIXED_SIZES,
        **{
            field: count(declared) if (declared := getattr(policy, sensor)) else 0
            for field, (sensor, count) in _OF_SENSORS.items()
        },
        "qpos": robot.qpos if robot else None,
        "qvel": robot.qvel if robot else None,
    }


def _named(policy: Policy, network: Network) -> Policy:
    """Returns a declaration with the names of the only input and the only output that are not kept filled in."""
    kept_in, kept_out = {each.input for each in policy.states}, {each.output for each in policy.states}
    free_in = [value.name for value in network.inputs if value.name not in kept_in]
    free_out = [value.name for value in network.outputs if value.name not in kept_out]
    inputs = policy.inputs
    if len(inputs) == len(free_in) == 1 and inputs[0].name is None:
        inputs = (inputs[0].model_copy(update={"name": free_in[0]}),)
    output = policy.output
    if output.name is None and len(free_out) == 1:
        output = output.model_copy(update={"name": free_out[0]})
    return policy.model_copy(update={"inputs": inputs, "output": output})


def _network_faults(network: Network) -> Iterator[str]:
    for domain, operator in sorted(network.operators):
        if domain not in _DOMAINS:
            yield f"operator {domain}::{operator}: libraries of operators are not loaded; export with ONNX's own"
        elif operator in _RANDOM:
            yield f"operator {operator}: draws numbers: an episode must follow from its seed; export without it"
    if network.elsewhere:
        names = ", ".join(list(dict.fromkeys(network.elsewhere))[:3])
        yield f"the numbers of {names} lie in another file: save the network as one file"


def _fit_faults(policy: Policy, network: Network, robot: RobotNumbers | None) -> Iterator[str]:
    inputs = {value.name: value for value in network.inputs}
    outputs = {value.name: value for value in network.outputs}
    used = [*(each.name for each in policy.inputs), *(each.input for each in policy.states)]
    yield from _name_faults("inputs", used, inputs)
    yield from _name_faults("outputs", [policy.output.name, *(each.output for each in policy.states)], outputs)
    missing = [name for name in inputs if name not in used]
    if missing:
        yield f"inputs: the network also takes {', '.join(missing)}"
    for number, each in enumerate(policy.inputs):
        yield from _part_faults(policy, number, each, robot)
        if each.name in inputs:
            yield from _input_faults(inputs[each.name], part_numbers(policy, each, robot))
    for each in policy.states:
        if each.input in inputs and each.output in outputs:
            yield from _state_faults(inputs[each.input], outputs[each.output])
    if policy.output.name in outputs:
        yield from _output_faults(policy, outputs[policy.output.name], robot)


def _name_faults(what: str, used: Sequence[str | None], there: Mapping[str, NetworkValue]) -> Iterator[str]:
    known = ", ".join(there) or "none"
    for name in dict.fromkeys(used):
        if name is None:
            yield f"{what}: one has no name, and it does not follow which is meant: the network has {known}"
        elif name not in there:
            yield f"{what}: {name!r}: the network has {known}"
        elif used.count(name) > 1:
            yield f"{what}: {name!r}: is named twice"


def _part_faults(policy: Policy, number: int, shown: PolicyInput, robot: RobotNumbers | None) -> Iterator[str]:
    sizes = _sizes(policy, robot)
    for place, part in enumerate(shown.parts):
        if sizes[part.field] == 0:
            lacks = _OF_SENSORS.get(part.field)
            without = f"declare the robot's {lacks[0]}" if lacks else "the robot is no more than a planar base"
            yield f"inputs.{number}.parts.{place}: {part.field}: {without}"


def _input_faults(value: NetworkValue, numbers: int | None) -> Iterator[str]:
    yield from _kind_faults(value)
    shape = value.shape
    if not shape or isinstance(shape[0], int):
        yield f"{_label(value)}: the first dimension must be open, for the lanes: export with a dynamic batch axis"
    elif numbers is not None and _lane_shape(shape, numbers) == ():
        yield f"{_label(value)}: its parts are {numbers} numbers a lane"


def _lane_shape(shape: Sequence[Dimension], numbers: int | None) -> tuple[int, ...]:
    """Returns the shape of one lane's part of an input; empty if so many numbers cannot have it."""
    if len(shape) == 2 and not isinstance(shape[1], int) and numbers is not None:
        return (numbers,)
    sizes = [size for size in shape[1:] if isinstance(size, int)]
    fits = len(sizes) == len(shape) - 1 > 0 and numbers in {None, math.prod(sizes)}
    return tuple(sizes) if fits else ()


def _state_faults(given: NetworkValue, kept: NetworkValue) -> Iterator[str]:
    yield from _kind_faults(given)
    yield from _kind_faults(kept)
    shape, after = given.shape or (), kept.shape
    if sum(not isinstance(size, int) for size in shape) != 1:
        yield f"{_label(given)}: exactly one dimension must be open, for the lanes"
    elif any(isinstance(size, int) and not 0 < size <= 1 << 20 for size in shape):
        yield f"{_label(given)}: is larger than any controller's memory"
    elif after is not None and (
        len(shape) != len(after) or any(isinstance(b, int) and a != b for a, b in zip(shape, after, strict=True))
    ):
        yield f"{_label(kept)}: cannot become the next step's {_label(given)}"


def _output_faults(policy: Policy, value: NetworkValue, robot: RobotNumbers | None) -> Iterator[str]:
    yield from _kind_faults(value)
    numbers = _numbers(value)
    if numbers == 0:
        yield f"{_label(value)}: the first dimension must be open, for the lanes: export with a dynamic batch axis"
    if isinstance(policy.output, ChoiceOutput):
        widths = {len(row) for row in policy.output.controls}
        if len(widths) > 1:
            yield f"output.controls: rows of {', '.join(map(str, sorted(widths)))} numbers: all must have as many"
        elif numbers not in {None, 0, len(policy.output.controls)}:
            yield f"{_label(value)}: output.controls has {len(policy.output.controls)} rows"
        numbers = widths.pop() if len(widths) == 1 else None
    if robot is None or numbers in {None, 0}:
        return
    allowed = {robot.ranged} if policy.output.kind == "action" else {robot.ranged, robot.actuators}
    if numbers not in allowed - {0}:
        meant = "actuators with a ctrlrange" if policy.output.kind == "action" else "actuators"
        yield f"output: {numbers} numbers a lane, where robot.xml has {max(allowed)} {meant}"


def _numbers(value: NetworkValue) -> int | None:
    """Returns how many numbers an output has for a lane; None if it does not say, 0 if lanes have no room in it."""
    if value.shape is None:
        return None
    if not value.shape or isinstance(value.shape[0], int):
        return 0
    sizes = [size for size in value.shape[1:] if isinstance(size, int)]
    return math.prod(sizes) if len(sizes) == len(value.shape) - 1 else None


def _kind_faults(value: NetworkValue) -> Iterator[str]:
    if value.kind != FLOAT32:
        yield f"{_label(value)}: must be of float32"


def _label(value: NetworkValue) -> str:
    if value.shape is None:
        return f"{value.name} of no shape"
    sizes = ", ".join("?" if size is None else str(size) for size in value.shape)
    return f"{value.name} of shape ({sizes})"
