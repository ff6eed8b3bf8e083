"""What a report shows of what failures have in common: shares, the parts of each variable, and a map of two."""

from math import log10

from specs.base import Spec
from tasks.results.report.rate_tables import short_world
from tasks.results.statistics.failure_causes import PARTS, WORLD, Cause, FailureCauses, FailureMap

_CELL = 10  # of the map, in units of its drawing
_DECADES = 3.0  # of the map's shades


class CauseBar(Spec):
    """A part of a variable's values, drawn as a column.

    Attributes:
        x: Its left edge, as CSS has lengths; likewise the others.
        width: Of it.
        y: Its upper edge.
        height: Of it, the most probable part being as high as the drawing.
        text: Which values, and how probable a failure is.
    """

    x: str
    width: str
    y: str
    height: str
    text: str


class CauseRow(Spec):
    """A variable, and how much it carries.

    Attributes:
        name: The variable's.
        share: Of what decides whether an episode fails.
        interval: Of the share.
        begin: Where the interval begins on a scale from 0 to 100 %, as CSS has lengths; likewise the others.
        length: Of the interval.
        dot: The share itself.
        bars: How probable a failure is in each part.
        most: The part where it is most probable, and how probable.
        more: How many values are left out.
    """

    name: str
    share: str
    interval: str
    begin: str
    length: str
    dot: str
    bars: tuple[CauseBar, ...]
    most: str
    more: int


class MapCell(Spec):
    """A square of the map: where, its shade from 0 to 1, and what it says."""

    x: int
    y: int
    shade: float
    text: str


class CauseMap(Spec):
    """How probable a failure is over two variables.

    Attributes:
        across: Name of the one from left to right.
        up: Of the one from below.
        size: Of the square drawing.
        cell: Of each square.
        cells: The squares.
        dots: Failures that were found (x, y).
        ends: What is left, right, below and above.
        strongest: How probable a failure is in the square with most shade.
        lightest: From which probability on squares have no shade.
    """

    across: str
    up: str
    size: int
    cell: int
    cells: tuple[MapCell, ...]
    dots: tuple[tuple[float, float], ...]
    ends: tuple[str, str, str, str]
    strongest: str
    lightest: str


class CausesView(Spec):
    """What failures have in common.

    Attributes:
        rows: The variable that carries most comes first.
        why: Why there are none.
        told: In how many of 100 pairs that were held back the surrogate tells the failure from the pass.
        map: None where not two numbers vary.
    """

    rows: tuple[CauseRow, ...]
    why: str
    told: int
    map: CauseMap | None


def causes_view(found: FailureCauses) -> CausesView:
    """Returns what a report shows of what failures have in common."""
    parts = {each.name: tuple(part.values for part in each.parts) for each in found.causes}
    return CausesView(
        rows=tuple(_row(each) for each in found.causes),
        why=found.why,
        told=round(100 * (found.told or 0.0)),
        map=_map(found.map, parts) if found.map else None,
    )


def _row(cause: Cause) -> CauseRow:
    low, high = cause.interval.lower, cause.interval.upper
    top = max(each.probability for each in cause.parts)
    width = 100.0 / len(cause.parts)
    most = max(cause.parts, key=lambda each: each.probability)
    said = short_world([each.values for each in cause.parts]) if cause.name == WORLD else str
    return CauseRow(
        name=cause.name,
        share=f"{100 * cause.share:.0f} %",
        interval=f"{100 * low:.0f} to {100 * high:.0f} %",
        begin=f"{100 * low:.2f}%",
        length=f"{100 * (high - low):.2f}%",
        dot=f"{100 * cause.share:.2f}%",
        bars=tuple(
            CauseBar(
                x=f"{at * width + 0.1 * width:.2f}%",
                width=f"{0.8 * width:.2f}%",
                y=f"{100 - 100 * each.probability / (top or 1.0):.1f}%",
                height=f"{100 * each.probability / (top or 1.0):.1f}%",
                text=f"{said(each.values)}: {how_often(each.probability)} "
                f"({how_often(each.interval.lower)} to {how_often(each.interval.upper)})",
            )
            for at, each in enumerate(cause.parts)
        ),
        most=f"{said(most.values)}: {how_often(most.probability)}",
        more=cause.more,
    )


def _map(found: FailureMap, parts: dict[str, tuple[str, ...]]) -> CauseMap:
    across, up = parts[found.across], parts[found.up]
    strongest = max(max(row) for row in found.probability)
    return CauseMap(
        across=found.across,
        up=found.up,
        size=PARTS * _CELL,
        cell=_CELL,
        cells=tuple(
            MapCell(
                x=_CELL * column,
                y=_CELL * (PARTS - 1 - row),
                shade=_shade(probability, strongest),
                text=f"{found.across} {across[column]}, {found.up} {up[row]}: {how_often(probability)}",
            )
            for row, found_row in enumerate(found.probability)
            for column, probability in enumerate(found_row)
        ),
        dots=tuple((round(PARTS * _CELL * x, 1), round(PARTS * _CELL * (1.0 - y), 1)) for x, y in found.failures),
        ends=(across[0], across[-1], up[0], up[-1]),
        strongest=how_often(strongest),
        lightest=how_often(strongest * 10.0**-_DECADES),
    )


def _shade(probability: float, strongest: float) -> float:
    """Returns how much shade a probability has: by its logarithm, so that a tenth has a third less."""
    if probability <= 0.0:
        return 0.0
    return round(max(0.0, 1.0 + log10(probability / strongest) / _DECADES), 3)


def how_often(probability: float) -> str:
    """Returns a probability as a person says it: in percent, or as one in how many."""
    if probability <= 0.0:
        return "none"
    return f"{100 * probability:.0f} %" if probability >= 0.1 else f"1 in {1.0 / probability:,.0f}"
