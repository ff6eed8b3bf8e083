"""A file of MJCF as elements, read with bounds: how deep, how many; no entities, and UTF-8 only."""

import xml.parsers.expat
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from tasks.simulate.refusal import MjcfRefused

MOST_ELEMENTS = 20_000
DEEPEST = 200
_ENCODINGS = {None, "utf-8", "us-ascii"}
_SHOWN = 80


@dataclass(frozen=True)
class Element:
    """An element of a file.

    Attributes:
        tag: Its name.
        attributes: As they stand.
        where: The file and the line, for a message.
        children: The elements in it.
    """

    tag: str
    attributes: Mapping[str, str]
    where: str
    children: "list[Element]" = field(default_factory=list)

    def refusal(self, what: str) -> MjcfRefused:
        """Returns the refusal of the file because of this element."""
        return MjcfRefused(f"{self.where}: {self.tag}: {what}")


def shown(text: str) -> str:
    """Returns a text of a stranger's for a message: quoted, and no longer than a message may be."""
    return repr(text if len(text) <= _SHOWN else f"{text[:_SHOWN]}...")


def read_elements(path: Path, name: str) -> Element:
    """Returns the outermost element of a file.

    Args:
        path: The file; no link.
        name: What messages call it.

    Raises:
        MjcfRefused: It is none, is too deep, declares a document type, or is not XML in UTF-8.
    """
    try:
        if path.is_symlink() or not path.is_file():
            raise MjcfRefused(f"{name}: no such file in the bundle")
        text = path.read_bytes()
        text.decode()  # what MuJoCo takes it for, whatever the file says of itself
    except (OSError, UnicodeDecodeError) as exc:
        raise MjcfRefused(f"{name}: cannot be read as UTF-8: {type(exc).__name__}") from exc
    return _Reader(name).read(text)


class _Reader:
    def __init__(self, name: str) -> None:
        self._name, self._stack, self._count = name, list[Element](), 0
        self._root: Element | None = None
        self._parser = xml.parsers.expat.ParserCreate()
        self._parser.StartElementHandler = self._begin
        self._parser.EndElementHandler = self._end
        self._parser.StartDoctypeDeclHandler = self._refuse_document_type
        self._parser.XmlDeclHandler = self._check_encoding

    def read(self, text: bytes) -> Element:
        try:
            self._parser.Parse(text, True)  # noqa: FBT003 - expat's signature
        except xml.parsers.expat.ExpatError as exc:
            raise MjcfRefused(f"{self._name}: not XML: {exc}") from exc
        if self._root is None:
            raise MjcfRefused(f"{self._name}: not XML: no element")
        return self._root

    def _where(self) -> str:
        return f"{self._name} line {self._parser.CurrentLineNumber}"

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        self._count += 1
        if self._count > MOST_ELEMENTS:
            raise MjcfRefused(f"{self._where()}: more than {MOST_ELEMENTS:,} elements")
        if len(self._stack) >= DEEPEST:
            raise MjcfRefused(f"{self._where()}: more than {DEEPEST} elements inside each other")
        element = Element(tag, attributes, self._where())
        if self._stack:
            self._stack[-1].children.append(element)
        else:
            self._root = element
        self._stack.append(element)

    def _end(self, _tag: str) -> None:
        self._stack.pop()

    def _refuse_document_type(self, *_declared: object) -> None:
        raise MjcfRefused(f"{self._where()}: declares a document type; write its entities out")

    def _check_encoding(self, _version: str, encoding: str | None, _standalone: int) -> None:
        if (encoding.lower() if encoding else None) not in _ENCODINGS:
            raise MjcfRefused(f"{self._where()}: encoding {shown(encoding or '')}: must be utf-8")
