"""Files of a source: found by the addresses that worlds use, never outside the folders that were given, and told.

A stranger's world names any file. What is read lies in the source's own folder or in a folder of models that whoever
imports has named; what leads out of them, by ``..``, an absolute path or a link, is a fault. XML declares no entities.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from xml.parsers.expat import ExpatError, ParserCreate

from specs.base import Fault
from tasks.worlds.importer.source_scene import SourceError

MODELS, MAPS = "models", "maps"
"""Folders of a package of ROS, beside that of its worlds."""
MOST_ELEMENTS = 500_000
DEEPEST = 100
_MOST_FILE_BYTES = 256 << 20
_MOST_BYTES = 1 << 30
_MOST_TEXT = 80
_MOST_FAULTS = 50
_ENCODINGS = frozenset({"utf-8", "us-ascii", "ascii", "iso-8859-1"})
_SCHEMES = ("model://", "package://", "file://", "fuel://", "https://", "http://")
_MOST_DROPPED = 4
"""How many folders at an address's beginning may be the place of another machine: ``package://name/models/...``."""


def shown(text: str) -> str:
    """Returns a stranger's text for a message: on one line, and no longer than a message may be."""
    line = " ".join(text.split())
    return line if len(line) <= _MOST_TEXT else f"{line[:_MOST_TEXT]}..."


def refused_file(path: Path, where: str, value: str, allowed: str) -> SourceError:
    """Returns the fault of a file beside a source: where in it, what stands there, and what may."""
    place = f"{path.name}: {where}" if where else path.name
    return SourceError([Fault(path=place, value=shown(value), allowed=allowed)], path.name)


def file_body(path: Path, most_bytes: int, what: str) -> bytes:
    """Returns what is in a file beside a source.

    Args:
        path: Of the file.
        most_bytes: It may have.
        what: Is in it, for a person: "routes".

    Raises:
        SourceError: It cannot be read, or is too large.
    """
    try:
        with path.open("rb") as file:
            body = file.read(most_bytes + 1)
    except OSError as exc:
        raise refused_file(path, "", exc.strerror or "cannot be read", f"a file of {what} that can be read") from exc
    if len(body) > most_bytes:
        raise refused_file(path, "", f"more than {most_bytes >> 20} MiB", f"a smaller file of {what}")
    return body


@dataclass
class Element:
    """An element of an XML file.

    Attributes:
        tag: Its name.
        attributes: As they stand.
        where: The file and the line.
        text: What stands in it before its first child.
        children: The elements in it.
    """

    tag: str
    attributes: Mapping[str, str]
    where: str
    text: str = ""
    children: "list[Element]" = field(default_factory=list)

    def get(self, name: str) -> str:
        """Returns an attribute; empty if it is not there."""
        return self.attributes.get(name, "").strip()

    def all(self, *tags: str) -> "Iterator[Element]":
        """Yields its children of some tags."""
        return (child for child in self.children if child.tag in tags)

    def first(self, path: str) -> "Element | None":
        """Returns the first element at a path of tags below it."""
        found: Element | None = self
        for tag in path.split("/"):
            found = next(found.all(tag), None) if found else None
        return found

    def said(self, path: str) -> str:
        """Returns the text of the first element at a path; empty if there is none."""
        found = self.first(path)
        return found.text.strip() if found else ""


class SourceFiles:
    """The files of one source.

    Attributes:
        digests: SHA-256 of each file that was read, by its name in the folder that it was found in.
        faults: What is wrong with the source; `check` raises them.
    """

    def __init__(self, source: Path, folders: Sequence[Path] = ()) -> None:
        self.digests: dict[str, str] = {}
        self.faults: list[Fault] = []
        self._source = source
        beside = [source.parent, source.parent / MODELS, source.parent.parent / MODELS]
        self._own = source.parent.resolve()
        self.folders = list(dict.fromkeys(each.resolve() for each in [*folders, *beside] if each.is_dir()))
        self._bytes, self._elements = 0, 0

    def fault(self, path: str, value: str, allowed: str) -> None:
        """Notes a fault; after many, raises them."""
        found = Fault(path=path, value=shown(value), allowed=allowed)
        if found not in self.faults:
            self.faults.append(found)
        if len(self.faults) >= _MOST_FAULTS:
            self.check()

    def check(self) -> None:
        """Raises what is wrong.

        Raises:
            SourceError: With all faults that were noted.
        """
        if self.faults:
            raise SourceError(self.faults, source=self._source.name)

    def refuse(self, path: str, value: str, allowed: str) -> SourceError:
        """Returns the error of a fault after which nothing more can be read, with all that were noted before."""
        last = Fault(path=path, value=shown(value), allowed=allowed)
        return SourceError([*self.faults, last], source=self._source.name)

    def name(self, path: Path) -> str:
        """Returns a file's name in the folder that it lies in."""
        real = path.resolve()
        inside = [real.relative_to(each).as_posix() for each in self._roots() if real.is_relative_to(each)]
        return min(inside, key=len, default=path.name)

    def read(self, path: Path) -> bytes:
        """Returns a file's bytes.

        Raises:
            SourceError: It is too large, or all files together are.
            OSError: It cannot be read.
        """
        name, size_bytes = self.name(path), path.stat().st_size
        self._bytes += size_bytes
        if size_bytes > _MOST_FILE_BYTES or self._bytes > _MOST_BYTES:
            allowed = f"at most {_MOST_FILE_BYTES >> 20} MiB a file, and {_MOST_BYTES >> 20} MiB in all"
            raise self.refuse(name, f"{size_bytes:,} bytes", allowed)
        data = path.read_bytes()
        self.digests[name] = hashlib.sha256(data).hexdigest()
        return data

    def elements(self, path: Path) -> Element:
        """Returns the outermost element of an XML file.

        Raises:
            ExpatError: It is no XML.
            SourceError: It declares a document type, or is too deep or too large.
            OSError: It cannot be read.
        """
        return _Reader(self, self.name(path)).parse(self.read(path))

    def count_element(self, where: str) -> None:
        """Counts an element of any file.

        Raises:
            SourceError: There are too many.
        """
        self._elements += 1
        if self._elements > MOST_ELEMENTS:
            raise self.refuse(where, f"{self._elements:,} elements", f"at most {MOST_ELEMENTS:,} in all files")

    def find(self, address: str, beside: Path, where: str) -> Path | None:
        """Returns the file or folder that an address means; None if there is none, or it may not be read.

        Args:
            address: ``model://``, ``package://``, ``file://``, a page of Fuel, or a relative path.
            beside: The folder of the file that names it.
            where: Which file and line names it, for a fault.
        """
        scheme = next((each for each in _SCHEMES if address.startswith(each)), "")
        rest = address.removeprefix(scheme)
        parts = PurePosixPath(rest).parts
        if "\0" in rest or ".." in parts or "\\" in rest:
            climbs = not scheme and "\0" not in rest and "\\" not in rest
            if not (climbs and self._inside(beside / rest)):
                self.fault(where, address, "a path without .., that stays in the folders of the source and its models")
                return None
        if not rest or len(rest) > 1_000:
            return None
        for path in self._candidates(scheme, PurePosixPath(rest), beside):
            if path.exists():
                if self._inside(path):
                    return path
                self.fault(
                    where, address, "a file in the folders of the source and its models; a link leads out of them"
                )
                return None
        return None

    def _candidates(self, scheme: str, rest: PurePosixPath, beside: Path) -> Iterator[Path]:
        if not scheme:
            yield beside / rest
            return
        if scheme == "file://" and rest.is_absolute() and self._inside(Path(rest)):
            yield Path(rest)
        parts = [part for part in rest.parts if part != "/"]
        if scheme in ("fuel://", "https://", "http://"):
            parts = parts[parts.index("models") + 1 :][:1] if "models" in parts[:-1] else parts[-1:]
            for folder in self.folders:
                yield from (folder / part for part in (*parts, *(part.lower() for part in parts)))
            return
        for dropped in range(min(_MOST_DROPPED, len(parts))):
            for folder in self.folders:
                yield folder.joinpath(*parts[dropped:])

    def _roots(self) -> list[Path]:
        return [*self.folders, self._own]

    def _inside(self, path: Path) -> bool:
        real = path.resolve()
        return any(real.is_relative_to(each) for each in self._roots())


class _Reader:
    """A file's elements, read by expat without entities of its own."""

    def __init__(self, files: SourceFiles, name: str) -> None:
        self._files, self._name = files, name
        self._stack: list[Element] = []
        self._texts: list[list[str]] = []
        self._root: Element | None = None
        self._parser = ParserCreate()
        self._parser.buffer_text = True
        self._parser.StartElementHandler = self._begin
        self._parser.EndElementHandler = self._end
        self._parser.CharacterDataHandler = self._text
        self._parser.StartDoctypeDeclHandler = self._refuse_document_type
        self._parser.XmlDeclHandler = self._check_encoding

    def parse(self, data: bytes) -> Element:
        self._parser.Parse(data, True)  # noqa: FBT003 - expat's signature
        if self._root is None:
            raise ExpatError("no element found")
        return self._root

    def _where(self) -> str:
        return f"{self._name} line {self._parser.CurrentLineNumber}"

    def _begin(self, tag: str, attributes: dict[str, str]) -> None:
        self._files.count_element(self._where())
        if len(self._stack) >= DEEPEST:
            raise self._files.refuse(self._where(), tag, f"at most {DEEPEST} elements inside each other")
        element = Element(tag, attributes, self._where())
        if self._stack:
            self._stack[-1].children.append(element)
        else:
            self._root = element
        self._stack.append(element)
        self._texts.append([])

    def _end(self, _tag: str) -> None:
        self._stack.pop().text = "".join(self._texts.pop())

    def _text(self, text: str) -> None:
        if self._texts:
            self._texts[-1].append(text)

    def _refuse_document_type(self, *_declared: object) -> None:
        raise self._files.refuse(self._where(), "a document type", "XML without one; write its entities out")

    def _check_encoding(self, _version: str, encoding: str | None, _standalone: int) -> None:
        if encoding and encoding.lower() not in _ENCODINGS:
            raise self._files.refuse(self._where(), f"encoding {encoding}", f"one of {', '.join(sorted(_ENCODINGS))}")
