"""What `simyard.worlds` returns: worlds, read one by one as they are asked for, and their drawings."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import overload

from simyard.answer.html import block, heading, paragraph, picture, text
from specs.data.world import World as WorldDocument

_PLAN_WIDTH, _SHEET_WIDTH = 760, 1040
_SHOWN = 24


@dataclass(frozen=True)
class World:
    """A world.

    Attributes:
        name: `<generation>/<world>`, as documents name it.
        document: All that is known of it: rooms, walls, doors, furniture, lights, its certificate.
    """

    name: str
    document: WorldDocument

    def __repr__(self) -> str:
        """Returns its name and its size."""
        return f"<World {self.name!r}: {_facts(self.document)}>"

    def _repr_svg_(self) -> str:
        from tasks.export.drawing.floor_plan import floor_plan_svg  # noqa: PLC0415 - only where it is drawn

        return floor_plan_svg(self.document)

    def _repr_html_(self) -> str:
        drawing = picture(self._repr_svg_(), f"The floor plan of {self.name}", _PLAN_WIDTH)
        return block(heading(self.name, text(_facts(self.document))), paragraph(drawing))


@dataclass(frozen=True, eq=False)
class Worlds(Sequence[World]):
    """Worlds in their order, each read when it is asked for.

    Attributes:
        title: What they have in common.
        names: `<generation>/<world>` of each.
        rejected: Why others could not be made, a sentence each.
    """

    title: str
    names: tuple[str, ...]
    rejected: tuple[str, ...] = ()
    _read: Callable[[str], WorldDocument] = field(repr=False, kw_only=True)

    @overload
    def __getitem__(self, index: int) -> World: ...

    @overload
    def __getitem__(self, index: slice) -> "Worlds": ...

    def __getitem__(self, index: "int | slice") -> "World | Worlds":
        """Returns a world by its position, or some of them."""
        if isinstance(index, slice):
            return Worlds(self.title, self.names[index], self.rejected, _read=self._read)
        name = self.names[index]
        return World(name, self._read(name))

    def __len__(self) -> int:
        """Returns how many there are."""
        return len(self.names)

    def __iter__(self) -> Iterator[World]:
        """Yields each world."""
        return (World(name, self._read(name)) for name in self.names)

    def __repr__(self) -> str:
        """Returns what they have in common, and how many there are."""
        return f"<Worlds {self.title!r}: {len(self)}>"

    def _repr_html_(self) -> str:
        if not self.names:
            return block(heading(self.title), paragraph("no worlds"))
        alt = f"A sheet of {min(_SHOWN, len(self))} of {len(self)} worlds"
        return block(picture(self._sheet, alt, _SHEET_WIDTH), *map(paragraph, self.rejected[:3]))

    @cached_property
    def _sheet(self) -> str:
        from tasks.export.picture.contact_sheet import contact_sheet_svg  # noqa: PLC0415 - only where it is drawn

        shown = [self._read(name) for name in self.names[:_SHOWN]]
        return contact_sheet_svg(shown, title=self.title, total=len(self))


def _facts(world: WorldDocument) -> str:
    box = world.footprint
    size = f"{box.x_max_m - box.x_min_m:.1f} x {box.y_max_m - box.y_min_m:.1f} m"
    unmet = len(world.certificate.unmet)
    wishes = f"{unmet} of {len(world.certificate.wishes)} wishes unmet" if unmet else "every wish met"
    rooms = "1 room" if len(world.rooms) == 1 else f"{len(world.rooms)} rooms"
    return f"{rooms}, {len(world.furniture)} pieces, {size}, {wishes}"
