"""Names in a ROS graph: absolute, relative to a node's namespace, or private to a node (wiki.ros.org/Names)."""

import re

from tasks.ros.graph.wire import graph_limits as limits

# As ROS's own master, which takes names with a dash though the rules have none; but nothing that splits a line.
_REFUSED = re.compile(r"[:\s\x00-\x1f\x7f]")


class GraphNameError(ValueError):
    """A name that a graph does not take."""


def check_name(name: object, what: str) -> str:
    """Returns the name.

    Args:
        name: As a node sent it.
        what: What it names, for the message.

    Raises:
        GraphNameError: If it is no text, empty, too long, or has a colon, a space or a control character.
    """
    if not isinstance(name, str) or not name:
        raise GraphNameError(f"{what} must be a text that is not empty")
    if len(name) > limits.NAME_CHARACTERS:
        raise GraphNameError(f"{what} has {len(name)} characters: {limits.NAME_CHARACTERS} are taken")
    if _REFUSED.search(name):
        raise GraphNameError(f"{what} {name[:80]!r}: a name has no colon, space or control character")
    return name


def resolve(name: str, node: str) -> str:
    """Returns the absolute name that a node means by a name.

    Args:
        name: ``/absolute``, ``relative`` or ``~private``; slashes at its end or in a row mean nothing.
        node: The absolute name of the node.
    """
    if name.startswith("/"):
        parts = split(name)
    elif name.startswith("~"):
        parts = [*split(node), *split(name[1:])]
    else:
        parts = [*split(node)[:-1], *split(name)]
    return "/" + "/".join(parts)


def split(name: str) -> list[str]:
    """Returns the parts of a name."""
    return [part for part in name.split("/") if part]
