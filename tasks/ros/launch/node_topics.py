"""Which topics a node's program subscribes to and publishes, read from its text, so that nothing has to run.

Only what stands there as text is known: of programs in Python, topics whose names are not computed. What a launch file
remaps and which namespace it starts a node in counts, as ROS resolves names (wiki.ros.org/Names).
"""

import ast
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

from specs.base import Spec
from tasks.ros.launch.launch_plan import NodePlan
from tasks.ros.launch.python2 import python_tree

# Calls, and which of their arguments are the topic's name and its type.
_WANTS = {"Subscriber": (0, 1), "wait_for_message": (0, 1), "create_subscription": (1, 0)}
_GIVES = {"Publisher": (0, 1), "create_publisher": (1, 0)}
_NAMES, _TYPES = ("name", "topic"), ("data_class", "topic_type", "msg_type")
_DOTTED = re.compile(r"(\w+)\.msg\.(\w+)")
# How an executable of a Python package of ROS 2 that is not built is run.
_IMPORT = re.compile(r"^import sys;.* from ([\w.]+) import \w+;")


class WantedTopic(Spec):
    """A topic that a node subscribes to.

    Attributes:
        node: Its name, package and program.
        topic: The full name.
    """

    node: str
    topic: str


class TypedTopic(Spec):
    """A topic that a node, or the robot, reads or writes, where its types are known.

    Attributes:
        node: Its name, package and program.
        topic: The full name.
        types: Such as ``sensor_msgs/LaserScan``; the robot takes several for commands.
    """

    node: str
    topic: str
    types: tuple[str, ...]


class NodeTopics(NamedTuple):
    """What is known of the topics of one node.

    Attributes:
        wants: Full names of what it subscribes to.
        gives: Of what it publishes.
        known: Whether its program could be read; others publish whatever they do.
        wanted_types: Of each topic that it subscribes to with one type that is known.
        given_types: Of each that it publishes so.
    """

    wants: tuple[str, ...] = ()
    gives: tuple[str, ...] = ()
    known: bool = False
    wanted_types: Mapping[str, str] = MappingProxyType({})
    given_types: Mapping[str, str] = MappingProxyType({})


def node_topics(node: NodePlan, bundle: Path) -> NodeTopics:
    """Returns the topics of a node whose program is in a bundle and in Python.

    Args:
        node: As the launch file starts it.
        bundle: Folder that holds the ROS packages.
    """
    tree = next((found for each in own_programs(node, bundle) if (found := python_tree(each)) is not None), None)
    if tree is None:
        return NodeTopics()
    names, types = _names(node), _imported_types(tree)
    wants, gives = (_typed(names, _topics(tree, calls), types) for calls in (_WANTS, _GIVES))
    read, written = ({topic: one for topic, one in each.items() if one} for each in (wants, gives))
    return NodeTopics((*wants,), (*gives,), known=True, wanted_types=read, given_types=written)


def _typed(names: "_Names", topics: Iterator[tuple[str, str]], types: Mapping[str, str]) -> dict[str, str]:
    """Returns full names of topics with their type; with none where it is not known, or where there are several."""
    found: dict[str, str] = {}
    for name, shown in topics:
        dotted, topic = _DOTTED.fullmatch(shown), names.full(name)
        one = f"{dotted[1]}/{dotted[2]}" if dotted else types.get(shown, "")
        found[topic] = one if found.get(topic, one) == one else ""
    return found


def _imported_types(tree: ast.Module) -> dict[str, str]:
    """Returns the types that a program imports from packages of messages, by its own names for them."""
    found: dict[str, str] = {}
    for each in ast.walk(tree):
        if isinstance(each, ast.ImportFrom) and each.module and not each.level and each.module.endswith(".msg"):
            package = each.module.removesuffix(".msg")
            for name in each.names:
                one, shown = f"{package}/{name.name}", name.asname or name.name
                found[shown] = one if found.get(shown, one) == one else ""
    return found


def own_programs(node: NodePlan, bundle: Path) -> Iterator[Path]:
    """Yields files of the bundle that a node's command runs; of a package that is not built it imports a function."""
    paths = [Path(each) for each in dict(node.environment).get("PYTHONPATH", "").split(":")]
    own = [each for each in paths if each.is_relative_to(bundle)]
    for word in node.command:
        if word.startswith(f"{bundle}/"):
            yield Path(word)
        elif found := _IMPORT.search(word):
            files = (folder.joinpath(*found[1].split(".")).with_suffix(".py") for folder in own)
            yield from (each for each in files if each.is_file())


def _topics(tree: ast.Module, calls: Mapping[str, tuple[int, int]]) -> Iterator[tuple[str, str]]:
    """Yields names of topics that calls have as text, each with the words that stand for its type."""
    for each in ast.walk(tree):
        if not isinstance(each, ast.Call):
            continue
        called = each.func.attr if isinstance(each.func, ast.Attribute) else getattr(each.func, "id", "")
        if called in calls:
            name, kind = calls[called]
            given = [*each.args[name : name + 1], *(word.value for word in each.keywords if word.arg in _NAMES)]
            types = [*each.args[kind : kind + 1], *(word.value for word in each.keywords if word.arg in _TYPES)]
            shown = ast.unparse(types[0]) if types else ""
            named = (one.value for one in given if isinstance(one, ast.Constant) and isinstance(one.value, str))
            yield from ((one, shown) for one in named)


class _Names(NamedTuple):
    node: str
    namespace: str
    remapped: dict[str, str]

    def full(self, name: str) -> str:
        """Returns a topic's full name."""
        found = self.absolute(name)
        return self.remapped.get(found, found)

    def absolute(self, name: str) -> str:
        """Returns a name as it stands in no namespace."""
        if name.startswith("/"):
            return name
        inner = (
            f"{self.node}/{name[1:].lstrip('/')}" if name.startswith("~") else f"{self.namespace.rstrip('/')}/{name}"
        )
        return f"/{inner.strip('/')}"


def _names(node: NodePlan) -> _Names:
    names = _Names(node.name, node.namespace, {})
    pairs = [word.partition(":=")[::2] for word in node.command if ":=" in word and not word.startswith("_")]
    return names._replace(remapped={names.absolute(old): names.absolute(new) for old, new in pairs})


def _same_name(topic: str, given: Sequence[str]) -> str:
    """Returns what to do about a topic of which one has the last name in another namespace; or empty."""
    last = topic.rpartition("/")[2]
    other = next((each for each in given if each.rpartition("/")[2] == last), None)
    return f": {other} is published; remap it, or name {topic} among topics in ros.yaml" if other else ""


def unpublished(
    wanted: Sequence[WantedTopic],
    given: Sequence[str],
    unknown: Sequence[str],
    declared_by: Mapping[str, str] = MappingProxyType({}),
) -> Iterator[str]:
    """Yields a sentence for each topic that a node wants and that nobody is known to publish.

    Args:
        wanted: What nodes subscribe to.
        given: Full names of what is published.
        unknown: Nodes whose programs could not be read.
        declared_by: Topics that a robot would publish, and what in its ``ros.yaml`` would declare their sensor.
    """
    perhaps = f", unless {', '.join(unknown[:3])}{' or others' if len(unknown) > 3 else ''} does" if unknown else ""
    for each in wanted:
        if each.topic not in given:
            field = declared_by.get(each.topic)
            hint = f": ros.yaml may declare {field}" if field else _same_name(each.topic, given)
            yield f"{each.node} wants {each.topic}, which nobody publishes{perhaps}{hint}"


def unlike(reads: Sequence[TypedTopic], writes: Sequence[TypedTopic]) -> Iterator[str]:
    """Yields a sentence for each two of which one writes a topic with another type than the other one reads."""
    for each in reads:
        for other in writes:
            if other.topic == each.topic and not set(other.types) & set(each.types):
                written, read = (" or ".join(one.types) for one in (other, each))
                said = f"{other.node} publishes {each.topic} as {written}, and {each.node} reads it as {read}"
                yield f"{said}: it does not arrive; give both one type"
