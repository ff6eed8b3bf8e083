"""What a reader makes of somebody's world: pieces of upright solids, and what is said of all that is not in them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from specs.base import Fault, Spec
from specs.data.world import FloorZone, Furniture, ImportFinding, Light, RecordedWalk, Route, Start
from specs.errors import DocumentError

MOST_SOLIDS = 20_000
"""Of a world that is imported; what is beyond that is noise, and its floor would be measured for hours."""


class SourceError(DocumentError):
    """A file is no world to import; carries all its faults: where in the source, the value, what may stand there."""


@dataclass(frozen=True)
class Scene:
    """A world as its source has it, in the source's frame, but for the floor, which is at z = 0.

    Attributes:
        pieces: Each model of the source, named as there (numbered where two have a name), and in no room.
        lights: Where the source has lights that shine from a place.
        start: Where the source says that a robot starts; None where it does not.
        parts: How many parts the source has that a robot could meet.
        exact: How many of them are in the pieces as they were.
        findings: All others, and what else was left out, in the source's order.
        files: SHA-256 of every file that was read, by its name relative to the source's folder, or to the model folder
            that it was found in.
        routes: Ways and places that came with it.
        zones: Parts of the floor that somebody named.
        walks: How people walk in it.
        floor_m: How high the floor stands in the source; the pieces are lower by that.
    """

    pieces: tuple[Furniture, ...]
    lights: tuple[Light, ...] = ()
    start: Start | None = None
    parts: int = 0
    exact: int = 0
    findings: tuple[ImportFinding, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    routes: tuple[Route, ...] = ()
    zones: tuple[FloorZone, ...] = ()
    walks: tuple[RecordedWalk, ...] = ()
    floor_m: float = 0.0


class ImportAnswer(Spec):
    """What came of an import, as the process that reads sources answers.

    Attributes:
        world: The canonical document of a world; empty where there is none.
        faults: Why there is none.
    """

    world: str = ""
    faults: tuple[Fault, ...] = ()
