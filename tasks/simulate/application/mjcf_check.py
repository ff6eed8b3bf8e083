"""Checks a robot's MJCF before MuJoCo reads it: a stranger's may name any file, and grow without bounds.

The file is read as elements first (how deep, how many; no entities, and UTF-8 only), then its numbers are held against
bounds, then the files that it names: only such as lie in its bundle, and are not too large once they are decoded.
Nothing here imports MuJoCo, so that who only reports a refusal need not either.
"""

import math
import os
import re
import struct
import xml.parsers.expat
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from specs.errors import SimyardError


class RobotRefused(SimyardError):  # noqa: N818 - a state
    """A robot.xml that does not load, or that an engine cannot represent; says which element, and the remedy."""


def refusal_lines(refusal: str) -> list[str]:
    """Returns the faults in a refusal, one a line, without the headings above lists of them."""
    return [" ".join(line.split()) for line in refusal.splitlines() if not line.endswith(" refuses the robot:")]


class MjcfRefused(RobotRefused):
    """A robot.xml that MuJoCo is not given: it leads out of its bundle, or grows beyond any robot."""


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


# MuJoCo itself cuts at 1e10 (mjMAXVAL); people write such numbers where they mean no limit.
_LARGEST = 1e15
_SHORTEST_STEP_S = 1e-5
_MOST_RANGE_STEPS = 20_000
_MEMORY_BYTES = 1 << 30
_PIXELS_OF_A_VERTEX = 2_000
_MULTIPLES = {"": 1, "K": 1 << 10, "M": 1 << 20, "G": 1 << 30, "T": 1 << 40, "P": 1 << 50, "E": 1 << 60}
_MEMORY = re.compile(r"(\d{1,19})([KMGTPE]?)", re.IGNORECASE)
# What C reads as a number and Python does not, or what is not finite.
_NO_NUMBER = re.compile(r"[+-]?(nan(\(\w*\))?|inf(inity)?|0x[0-9a-f]*\.?[0-9a-f]*(p[+-]?\d+)?)", re.IGNORECASE)
_NAMES = frozenset({"name", "class", "childclass", "prefix"})


class _Bound(NamedTuple):
    """The most that each number of an attribute may be, and their product.

    Attributes:
        each: Of a single one.
        product: Of all; None if nothing multiplies them.
    """

    each: float
    product: float | None = None


_ANY = "*"
_BOUNDS: Mapping[tuple[str, str], _Bound] = {
    **{("size", name): _Bound(100_000) for name in ("njmax", "nconmax", "nuserdata", "nkey")},
    ("size", "nstack"): _Bound(1e8),
    **{
        ("size", f"nuser_{name}"): _Bound(100)
        for name in ("actuator", "body", "cam", "geom", "jnt", "sensor", "site", "tendon")
    },
    **{
        ("option", name): _Bound(10_000)
        for name in ("iterations", "ls_iterations", "noslip_iterations", "ccd_iterations")
    },
    **{("option", name): _Bound(1_000) for name in ("sdf_iterations", "sdf_initpoints")},
    ("hfield", "nrow"): _Bound(2_000),
    ("hfield", "ncol"): _Bound(2_000),
    ("texture", "width"): _Bound(4_096),
    ("texture", "height"): _Bound(24_576),
    ("texture", "nchannel"): _Bound(4),
    ("texture", "gridsize"): _Bound(64),
    ("mesh", "params"): _Bound(1_000, 20_000),
    ("skin", "subgrid"): _Bound(20),
    ("numeric", "size"): _Bound(10_000),
    ("user", "dim"): _Bound(1_000),
    ("contact", "num"): _Bound(1_000),
    ("camera", "resolution"): _Bound(8_192),
    ("global", "offwidth"): _Bound(8_192),
    ("global", "offheight"): _Bound(8_192),
    ("quality", "shadowsize"): _Bound(16_384),
    ("quality", "offsamples"): _Bound(64),
    **{("quality", name): _Bound(1_024) for name in ("numslices", "numstacks", "numquads")},
    (_ANY, "nsample"): _Bound(1_000),
    (_ANY, "actdim"): _Bound(100),
}


# Only what is far from any robot is refused: the bounds keep the time until a file is refused, or compiled, near a
# second.
def check_numbers(element: Element) -> None:
    """Refuses an element with a number that is none, or far beyond what any robot needs.

    Raises:
        MjcfRefused: It has one; says which attribute, and what is allowed.
    """
    for name, text in element.attributes.items():
        if name not in _NAMES:
            _check_attribute(element, name, text)
    if element.tag in {"option", "lengthrange"}:
        _check_step(element)
    if element.tag == "lengthrange":
        _check_range(element)


def numbers(element: Element, name: str) -> list[float]:
    """Returns the numbers of an attribute; none if it is not there.

    Raises:
        MjcfRefused: What stands there are no numbers.
    """
    try:
        return [float(part) for part in element.attributes.get(name, "").split()]
    except ValueError as exc:
        raise element.refusal(f"{name} {shown(element.attributes[name])}: must be numbers") from exc


def made_pixels(element: Element) -> float:
    """Returns how many pixels, heights or vertices MuJoCo makes for an element without a file; 0 for most."""
    size = {"texture": ("width", "height"), "hfield": ("nrow", "ncol"), "mesh": ("params",)}.get(element.tag, ())
    found = [abs(number) for name in size for number in numbers(element, name)]
    # MuJoCo takes about as long for a vertex's hull as for so many pixels.
    return math.prod(found) * (_PIXELS_OF_A_VERTEX if element.tag == "mesh" else 1) if found else 0.0


def _check_attribute(element: Element, name: str, text: str) -> None:
    for part in text.split():
        if _NO_NUMBER.fullmatch(part) or abs(_number(part)) > _LARGEST:
            raise element.refusal(f"{name} {shown(text)}: must be finite, and at most {_LARGEST:g}")
    bound = _BOUNDS.get((element.tag, name)) or _BOUNDS.get((_ANY, name))
    if bound is not None:
        _check_bound(element, name, bound)
    if (element.tag, name) == ("size", "memory"):
        _check_memory(element, text)


def _check_bound(element: Element, name: str, bound: _Bound) -> None:
    found = [abs(number) for number in numbers(element, name)]
    if any(number > bound.each for number in found):
        raise element.refusal(f"{name} {shown(element.attributes[name])}: must be at most {bound.each:,.0f}")
    if bound.product is not None and math.prod(max(number, 1.0) for number in found) > bound.product:
        raise element.refusal(
            f"{name} {shown(element.attributes[name])}: their product must be at most {bound.product:,.0f}"
        )


def _check_memory(element: Element, text: str) -> None:
    found = _MEMORY.fullmatch(text.strip())
    if text.strip() == "-1":  # MuJoCo's own choice
        return
    if found is None or int(found[1]) * _MULTIPLES[found[2].upper()] > _MEMORY_BYTES:
        raise element.refusal(f"memory {shown(text)}: must be at most 1G, such as 64M")


def _check_step(element: Element) -> None:
    if any(0.0 < step_s < _SHORTEST_STEP_S for step_s in numbers(element, "timestep")):
        given = shown(element.attributes["timestep"])
        raise element.refusal(f"timestep {given} s: must be at least {_SHORTEST_STEP_S:g}")


def _check_range(element: Element) -> None:
    step_s, total_s = (
        next(iter(numbers(element, name)), given) for name, given in (("timestep", 0.01), ("inttotal", 10))
    )
    if step_s > 0 and total_s / step_s > _MOST_RANGE_STEPS:
        raise element.refusal(f"inttotal of {total_s / step_s:,.0f} time steps: must be at most {_MOST_RANGE_STEPS:,}")


def _number(part: str) -> float:
    """Returns a number, or 0 for what is none."""
    try:
        found = float(part)
    except ValueError:
        return 0.0
    return found if math.isfinite(found) else math.inf


_FILES: Mapping[str, tuple[str, ...]] = {
    "include": ("file",),
    "mesh": ("file",),
    "hfield": ("file",),
    "skin": ("file",),
    "model": ("file",),
    "flexcomp": ("file",),
    "texture": ("file", "fileback", "filedown", "filefront", "fileleft", "fileright", "fileup"),
    "compiler": ("assetdir", "meshdir", "texturedir"),
}
_MOST_ENTRIES = 20_000
_MOST_FILE_BYTES = 64 << 20
_MOST_PIXELS = 4_096 * 24_576
_PNG = b"\x89PNG\r\n\x1a\n"
_PNG_SIZE = struct.Struct(">II")
_HEIGHTS = struct.Struct("<ii")
# A scheme, as MuJoCo's resource providers have, or a drive.
_SCHEME = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*:")


# Where MuJoCo looks for a file depends on the folders of `compiler`, on the file that names it, and on `strippath`.
# Here a name stands for every file of the bundle that it could be, so that none is forgotten.
class BundleFiles:
    """The files of a bundle, looked up by the names that an MJCF gives them."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._pixels = 0.0

    def check(self, element: Element) -> None:
        """Refuses an element that names a file outside the bundle, a link, or one that decodes to too much.

        Raises:
            MjcfRefused: It does.
        """
        for name in _FILES.get(element.tag, ()):
            given = element.attributes.get(name, "")
            climbs = ".." in given.split("/") or given.startswith("/") or "\\" in given
            if climbs or _SCHEME.match(given) or not given.isprintable():
                allowed = "must be a path inside the bundle, without `..`, `\\` and `:`"
                raise element.refusal(f"{name} {shown(given)}: {allowed}")
            for path in self.found(given):
                self._spend(element, _pixels_of(element, name, path))
        self._spend(element, made_pixels(element))

    def _spend(self, element: Element, pixels: float) -> None:
        self._pixels += pixels
        if self._pixels > _MOST_PIXELS:
            raise element.refusal(f"pictures and shapes of more than {_MOST_PIXELS:,} points in all")

    def found(self, given: str) -> list[Path]:
        """Returns every file of the bundle that a relative path may stand for."""
        return self._by_name.get(Path(given).name, []) if given else []

    def name(self, path: Path) -> str:
        """Returns what messages call a file."""
        return path.relative_to(self._root).as_posix()

    @cached_property
    def _by_name(self) -> Mapping[str, list[Path]]:
        found: dict[str, list[Path]] = {}
        entries = 0
        for base, folders, names in os.walk(self._root):
            entries += len(folders) + len(names)
            if entries > _MOST_ENTRIES:
                raise MjcfRefused(f"more than {_MOST_ENTRIES:,} files in the bundle")
            for name in (*folders, *names):
                path = Path(base, name)
                if path.is_symlink():
                    raise MjcfRefused(f"{shown(self.name(path))}: a link in the bundle; copy what it points to")
                if path.is_file():
                    found.setdefault(name, []).append(path)
        return found


def _pixels_of(element: Element, name: str, path: Path) -> int:
    """Returns how many points a file decodes to; refuses one that is too large."""
    given = shown(element.attributes[name])
    try:
        size_bytes = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(24)
    except OSError as exc:
        raise element.refusal(f"{name} {given}: cannot be read: {type(exc).__name__}") from exc
    if size_bytes > _MOST_FILE_BYTES:
        raise element.refusal(f"{name} {given}: larger than {_MOST_FILE_BYTES:,} bytes")
    return _decoded(element.tag, head)


def _decoded(tag: str, head: bytes) -> int:
    """Returns how many pixels a picture, or heights a field of them, holds, as its beginning says; 0 for others."""
    if head.startswith(_PNG) and len(head) == 24:
        width, height = _PNG_SIZE.unpack(head[16:24])
        return width * height
    if tag == "hfield" and len(head) >= _HEIGHTS.size:
        rows, columns = _HEIGHTS.unpack(head[: _HEIGHTS.size])
        return abs(rows) * abs(columns)
    return 0


_ROOTS = {"mujoco", "mujocoinclude"}
_MOST_MADE = 5_000
_MOST_FILES = 100
_MOST_XML_BYTES = 16 << 20
# How many elements each point is counted for: of a flex a body, its joints and a geom; a cable of bodies inside each
# other costs much more.
_MADE_OF_A_POINT = {"flexcomp": 5, "composite": 20}


# Nothing is compiled here, so that a file which would keep MuJoCo busy for hours is refused in a fraction of a
# second. What a file may hold is told in docs/guide/applications.md; it is far beyond any robot's.
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
        if self._bytes > _MOST_XML_BYTES:
            raise MjcfRefused(f"{name}: more than {_MOST_XML_BYTES:,} bytes of XML in all files")
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
