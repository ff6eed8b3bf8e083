"""Names of ROS 1's graph, and an episode's parameters by such names.

The rules are those of wiki.ros.org/Names and wiki.ros.org/Parameter%20Server.
"""

import copy
import re
from collections.abc import Iterator

from tasks.ros.graph import graph_limits as limits
from tasks.ros.graph.xml_rpc import Value, XmlRpcError, weight

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


def resolve_name(name: str, node: str) -> str:
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


Change = tuple[str, Value]
"""A name with a slash at its end, as ROS's own master writes it; the new value, or an empty mapping if deleted."""


class ParameterError(ValueError):
    """A parameter that cannot be set or deleted."""


class ParameterTree:
    """All parameters of an episode."""

    def __init__(self) -> None:
        # Under an empty name, so that the root is set as any namespace is.
        self._top: dict[str, Value] = {"": {}}
        self._bytes = weight(self._top)

    def get(self, name: str) -> Value:
        """Returns a value, or a mapping for a namespace: not a copy.

        Args:
            name: Absolute.

        Raises:
            KeyError: If it is not set.
        """
        found: Value = self._top
        for part in ("", *split(name)):
            if not isinstance(found, dict) or part not in found:
                raise KeyError(name)
            found = found[part]
        return found

    def has(self, name: str) -> bool:
        """Returns whether a parameter or namespace is set."""
        try:
            self.get(name)
        except KeyError:
            return False
        return True

    def set(self, name: str, value: Value) -> None:
        """Sets a value; a mapping replaces the whole namespace, and a value on the way becomes a namespace.

        Args:
            name: Absolute; ``/`` for all.
            value: Kept as a copy.

        Raises:
            ParameterError: If XML-RPC has no form for it, it is too big, or the root is to be no mapping.
        """
        parts = split(name)
        if not parts and not isinstance(value, dict):
            raise ParameterError("/ holds all parameters: only a mapping can take its place")
        try:
            weight(value, depth=len(parts))
        except XmlRpcError as exc:
            raise ParameterError(f"{name}: {exc}") from exc
        below, rest = self._namespace(parts)
        key, *missing = rest
        new = _wrap(copy.deepcopy(value), missing)
        total = self._bytes - _weight_of(below, key) + weight(key) + weight(new)
        if total > limits.PARAMETER_BYTES:
            raise ParameterError(f"{name}: all parameters would take {total} bytes, {limits.PARAMETER_BYTES} are kept")
        below[key] = new
        self._bytes = total

    def delete(self, name: str) -> None:
        """Deletes a parameter or namespace.

        Raises:
            KeyError: If it is not set.
            ParameterError: If it is the root.
        """
        *above, last = split(name) or [""]
        if not last:
            raise ParameterError("/ holds all parameters: it cannot be deleted")
        holder = self.get("/" + "/".join(above))
        if not isinstance(holder, dict) or last not in holder:
            raise KeyError(name)
        self._bytes -= _weight_of(holder, last)
        del holder[last]

    def names(self) -> list[str]:
        """Returns the absolute names of all values that are no mappings."""
        return list(_leaves("", self._top[""]))

    def search(self, name: str, node: str) -> str | None:
        """Returns the absolute name of a parameter in the innermost namespace that has its first part.

        Args:
            name: Relative, such as ``robot_description/arm``; an absolute one is looked up as it is.
            node: Where the search begins: in the namespace of the node's own name, then outward.
        """
        if name.startswith("/"):
            return name if self.has(name) else None
        first, *rest = split(name)
        scopes = split(node)
        for depth in range(len(scopes), -1, -1):
            found = [*scopes[:depth], first]
            if self.has("/" + "/".join(found)):
                return "/" + "/".join([*found, *rest])
        return None

    def _namespace(self, parts: list[str]) -> tuple[dict[str, Value], list[str]]:
        """Returns the innermost namespace there is above a name, and the parts of the name that are below it."""
        below, rest = self._top, ["", *parts]
        while len(rest) > 1 and isinstance(found := below.get(rest[0]), dict):
            below, rest = found, rest[1:]
        return below, rest


def change_for(subscription: str, name: str, value: Value) -> Change | None:
    """Returns what a node must hear that follows a parameter, after one was set or deleted; None for nothing.

    Args:
        subscription: Absolute name of what the node follows.
        name: Absolute name of what was set or deleted.
        value: The new value; an empty mapping if it was deleted.
    """
    follows, changed = split(subscription), split(name)
    if changed[: len(follows)] == follows:
        return _with_slash(changed), value
    if follows[: len(changed)] != changed:
        return None
    found = value
    for part in follows[len(changed) :]:
        found = found.get(part, {}) if isinstance(found, dict) else {}
    return _with_slash(follows), found


def _wrap(value: Value, names: list[str]) -> Value:
    return {names[0]: _wrap(value, names[1:])} if names else value


def _weight_of(holder: dict[str, Value], key: str) -> int:
    return weight(key) + weight(holder[key]) if key in holder else 0


def _with_slash(parts: list[str]) -> str:
    return "/" + "".join(f"{part}/" for part in parts)


def _leaves(prefix: str, value: Value) -> Iterator[str]:
    if isinstance(value, dict):
        for key, below in value.items():
            yield from _leaves(f"{prefix}/{key}", below)
    else:
        yield prefix
