"""Checks a robot's MJCF before MuJoCo reads it: a stranger's may name any file, and grow without bounds.

Nothing is compiled here, so that a file which would keep MuJoCo busy for hours is refused in a fraction of a second.
What a file may hold is told in docs/guide/applications.md; it is far beyond any robot's.
"""

import math
from collections.abc import Iterator
from pathlib import Path

from tasks.simulate.application.mjcf_files import BundleFiles
from tasks.simulate.application.mjcf_numbers import check_numbers, numbers
from tasks.simulate.application.mjcf_xml import DEEPEST, MOST_ELEMENTS, Element, read_elements
from tasks.simulate.refusal import MjcfRefused

_ROOTS = {"mujoco", "mujocoinclude"}
_MOST_MADE = 5_000
_MOST_FILES = 100
_MOST_BYTES = 16 << 20
# How many elements each point is counted for: of a flex a body, its joints and a geom; a cable of bodies inside each
# other costs much more.
_MADE_OF_A_POINT = {"flexcomp": 5, "composite": 20}


def check_mjcf(path: Path) -> None:
    """Refuses a file of MJCF that is none, or that holds what no robot needs, with all files that it names.

    Args:
        path: The file; its folder is the bundle.

    Raises:
        MjcfRefused: Says the file, the line, the element, and what is allowed.
    """
    _Check(path.parent).model(path, ())


def _too_many(where: str) -> MjcfRefused:
    makers = "replicate, composite, flexcomp and attach"
    return MjcfRefused(f"{where}: {makers} make more than {_MOST_MADE:,} elements")


class _Check:
    """The files of a model that were read, and how many elements they hold and make."""

    def __init__(self, root: Path) -> None:
        self._files = BundleFiles(root)
        self._read, self._bytes, self._elements = 0, 0, 0
        self._sizes: dict[Path, float] = {}

    def model(self, path: Path, chain: tuple[Path, ...]) -> float:
        """Returns how many elements a model's file holds and makes.

        Args:
            path: The file.
            chain: The models that attach it.
        """
        if path in chain:
            raise MjcfRefused(f"{self._files.name(path)}: attaches itself")
        if path not in self._sizes:
            whole = self._with_includes(self._open(path), (path,))
            attached = [self.model(each, (*chain, path)) for each in self._attached(whole)]
            made = _made(whole, 1.0, max(attached, default=0.0))
            self._sizes[path] = made + sum(1 for _ in _all(whole))
        return self._sizes[path]

    def _open(self, path: Path) -> Element:
        """Returns a file's outermost element, all of whose elements were looked at one by one."""
        name, self._read = self._files.name(path), self._read + 1
        if self._read > _MOST_FILES:
            raise MjcfRefused(f"{name}: one file too many; a model may have {_MOST_FILES}")
        self._bytes += path.stat().st_size if path.is_file() else 0
        if self._bytes > _MOST_BYTES:
            raise MjcfRefused(f"{name}: more than {_MOST_BYTES:,} bytes of XML in all files")
        root = read_elements(path, name)
        if root.tag not in _ROOTS:
            raise root.refusal("a robot's file must begin with mujoco; MuJoCo's compile program converts a URDF")
        for element in _all(root):
            self._elements += 1
            self._check(element)
        if self._elements > MOST_ELEMENTS:
            raise MjcfRefused(f"{name}: more than {MOST_ELEMENTS:,} elements in all files")
        return root

    def _check(self, element: Element) -> None:
        if element.tag in {"extension", "plugin"}:
            raise element.refusal("plugins are libraries of a machine, and no bundle may ask for them")
        check_numbers(element)
        self._files.check(element)

    def _with_includes(self, element: Element, included: tuple[Path, ...], depth: int = 0) -> Element:
        """Returns an element with what it includes in the place of each `include`."""
        if depth > DEEPEST:
            raise element.refusal(f"more than {DEEPEST} elements inside each other")
        children: list[Element] = []
        for child in element.children:
            found = self._files.found(child.attributes.get("file", "")) if child.tag == "include" else []
            for path in found:
                if path not in included:  # MuJoCo takes no file twice
                    whole = self._with_includes(self._open(path), (*included, path), depth + 1)
                    children += whole.children
            if not found:
                children.append(self._with_includes(child, included, depth + 1))
        return Element(element.tag, element.attributes, element.where, children)

    def _attached(self, whole: Element) -> list[Path]:
        named = (each.attributes.get("file", "") for each in _all(whole) if each.tag == "model")
        return [path for given in named for path in self._files.found(given)]


def _all(root: Element) -> Iterator[Element]:
    """Yields an element and all in it."""
    waiting = [root]
    while waiting:
        element = waiting.pop()
        yield element
        waiting += element.children


def _made(element: Element, times: float, attached: float) -> float:
    """Returns how many elements come of one that is made so many times, beyond those that are written.

    Args:
        element: With all that it includes.
        times: How often what it stands in is made.
        attached: How many elements one `attach` brings.
    """
    found = 0.0
    if element.tag == "replicate":
        times *= _points(element, "count")
    elif element.tag in {"composite", "flexcomp"}:
        found += times * _MADE_OF_A_POINT[element.tag] * max(_points(element, "count"), _points(element, "cellcount"))
    elif element.tag == "attach":
        found += times * attached
    if times > 1:
        found += times
    found += sum(_made(child, times, attached) for child in element.children)
    if found > _MOST_MADE:
        raise _too_many(element.where)
    return found


def _points(element: Element, name: str) -> float:
    """Returns the product of the counts of an attribute, each at least 1."""
    return math.prod(max(abs(count), 1.0) for count in numbers(element, name))
