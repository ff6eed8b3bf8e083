"""`simyard world template`: writes a template to begin with, and says what to do with it."""

from collections.abc import Iterator
from pathlib import Path
from typing import get_args

from specs.base import Fault
from specs.data.world import RoomType
from specs.errors import DocumentError
from tasks.documents.shape_text import meant_text, same_word
from tasks.worlds.starter.commented_yaml import commented_yaml
from tasks.worlds.starter.starter_template import Version, starter_json, starter_template

_MOST_ROOMS = 6
_ROOM_TYPES: dict[str, RoomType] = {str(kind): kind for kind in get_args(RoomType)}
_VERSIONS: dict[str, Version] = {"1": "1", "2": "2"}
_SUFFIXES = (".yaml", ".yml", ".json")


def write_starter(output: Path, rooms: str, version: str) -> None:
    """Writes a template into a file that is not there yet.

    Args:
        output: The file; JSON if its name ends in .json, else YAML.
        rooms: Types of rooms with commas between them.
        version: Of the template, 1 or 2.

    Raises:
        DocumentError: For rooms or a version that there are not, and for a file that is there or cannot be written.
    """
    faults = [*_room_faults(_words(rooms)), *_version_faults(version), *_suffix_faults(output)]
    if faults:
        raise DocumentError(faults, "simyard world template")
    body = starter_template([_ROOM_TYPES[same_word(word, _ROOM_TYPES)] for word in _words(rooms)], _VERSIONS[version])
    text = starter_json(body) if output.suffix.lower() == ".json" else commented_yaml(body)
    if output.exists():
        raise _refused(f"{output} is there already", "another name; nothing was written")
    try:
        output.parent.mkdir(parents=True, exist_ok=True)
        # Created, never replaced, also when somebody else is quicker.
        with output.open("x", encoding="utf-8") as file:
            file.write(text)
    except OSError as exc:
        raise _refused(f"{output} cannot be written ({exc.strerror})", "a file that can be written") from exc


def next_steps(output: Path) -> Iterator[str]:
    """Yields what to do with a template that was written."""
    yield "Change what you like, then look at the worlds that it gives:"
    yield f"  simyard world preview {output} --output plan.svg"
    yield f"  simyard world sheet {output} --output sheet.svg"
    yield "A document makes worlds of it, with the path as seen from the document's folder:"
    yield "  worldGeneration:"
    yield f"    template: {output}"
    yield "    worldCount: {floorplanCount: 5, interiorCountPerFloorplan: 2}"


def _words(rooms: str) -> list[str]:
    return [word.strip() for word in rooms.split(",")]


def _room_faults(words: list[str]) -> Iterator[Fault]:
    for word in words:
        if not same_word(word, _ROOM_TYPES):
            known = [kind.lower() for kind in _ROOM_TYPES]
            yield Fault(path="--rooms", value=repr(word), allowed=f"{meant_text(word, known)}one of {', '.join(known)}")
    if len(words) > _MOST_ROOMS:
        yield Fault(path="--rooms", value=f"{len(words)} rooms", allowed=f"from 1 to {_MOST_ROOMS}")


def _version_faults(version: str) -> Iterator[Fault]:
    if version not in _VERSIONS:
        yield Fault(path="--version", value=repr(version), allowed="1 or 2")


def _suffix_faults(output: Path) -> Iterator[Fault]:
    if output.suffix.lower() not in _SUFFIXES:
        yield Fault(path="--output", value=str(output), allowed=f"a file that ends in {', '.join(_SUFFIXES)}")


def _refused(value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="--output", value=value, allowed=allowed)], "simyard world template")
