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

# Calls, and which of their arguments is the topic's name.
_WANTS = {"Subscriber": 0, "wait_for_message": 0, "create_subscription": 1}
_GIVES = {"Publisher": 0, "create_publisher": 1}
_NAMES = ("name", "topic")
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


class NodeTopics(NamedTuple):
    """What is known of the topics of one node.

    Attributes:
        wants: Full names of what it subscribes to.
        gives: Of what it publishes.
        known: Whether its program could be read; others publish whatever they do.
    """

    wants: tuple[str, ...] = ()
    gives: tuple[str, ...] = ()
    known: bool = False


def node_topics(node: NodePlan, bundle: Path) -> NodeTopics:
    """Returns the topics of a node whose program is in a bundle and in Python.

    Args:
        node: As the launch file starts it.
        bundle: Folder that holds the ROS packages.
    """
    tree = next((found for each in own_programs(node, bundle) if (found := python_tree(each)) is not None), None)
    if tree is None:
        return NodeTopics()
    names = _names(node)
    wants = dict.fromkeys(names.full(each) for each in _topics(tree, _WANTS))
    gives = dict.fromkeys(names.full(each) for each in _topics(tree, _GIVES))
    return NodeTopics((*wants,), (*gives,), known=True)


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


def _topics(tree: ast.Module, calls: dict[str, int]) -> Iterator[str]:
    for each in ast.walk(tree):
        if not isinstance(each, ast.Call):
            continue
        called = each.func.attr if isinstance(each.func, ast.Attribute) else getattr(each.func, "id", "")
        if called in calls:
            place = calls[called]
            given = [*each.args[place : place + 1], *(word.value for word in each.keywords if word.arg in _NAMES)]
            yield from (one.value for one in given if isinstance(one, ast.Constant) and isinstance(one.value, str))


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
