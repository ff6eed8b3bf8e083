"""Draws episodes that came out differently in two batches: both paths of each on the plan of their world."""

from collections.abc import Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from jaxtyping import Float

from tasks.results.compare.comparison import EpisodeFlip
from tasks.results.playback.plan_scale import PlanPage, draw_over, plan_page

_STYLE = """
.flips{fill:none;stroke-linejoin:round;stroke-linecap:round;stroke-width:2.6}
.flips .first{stroke:#0072b2;stroke-dasharray:7 5}.flips .second{stroke:#d55e00}
.flips .lost{stroke-width:3}.flips text{stroke:none;fill:#23272b;font-size:12px;text-anchor:end}
.flips g:hover>.first,.flips g:hover>.second{stroke-width:5}
"""
_PASSED = "passed"


class FlipPaths(NamedTuple):
    """A flip and the ways that the robot took; None where one is not known."""

    flip: EpisodeFlip
    first_m: Float[np.ndarray, "samples 2"] | None
    second_m: Float[np.ndarray, "samples 2"] | None


def flip_map_svg(plan: str, ways: Sequence[FlipPaths]) -> str:
    """Returns the plan with both ways of each flip, a ring where one passed, a cross where it did not.

    Args:
        plan: A floor plan as the export draws it.
        ways: Flips in that world.

    Raises:
        ValueError: The plan does not say its scale.
    """
    page = plan_page(plan)
    root = ET.Element("g", {"class": "flips"})
    ET.SubElement(root, "style").text = _STYLE
    for each in ways:
        group = ET.SubElement(root, "g")
        ET.SubElement(group, "title").text = flip_text(each.flip)
        for name, way_m, why in (("first", each.first_m, each.flip.before), ("second", each.second_m, each.flip.after)):
            if way_m is not None and len(way_m):
                _way(group, page, name, way_m, why)
    _legend(root, page)
    return draw_over(plan, root)


def flip_text(flip: EpisodeFlip) -> str:
    """Returns a flip in one line: which episode, and how it came out before and after."""
    values = "".join(f" {name}={value}" for name, value in sorted(flip.environment.items()))
    return (
        f"{flip.world} seed {flip.seed}{values} ({flip.first} -> {flip.second}): "
        f"{flip.before or _PASSED} -> {flip.after or _PASSED}"
    )


def _way(parent: ET.Element, page: PlanPage, name: str, way_m: Float[np.ndarray, "samples 2"], why: str) -> None:
    points = [page.at(point) for point in way_m]
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    ET.SubElement(parent, "polyline", {"class": name, "points": line})
    x, y = points[-1]
    if why:
        ET.SubElement(parent, "path", {"class": f"{name} lost", "d": f"M{x:.1f} {y:.1f}m-6 -6l12 12m0 -12l-12 12"})
    else:
        ET.SubElement(parent, "circle", {"class": name, "cx": f"{x:.1f}", "cy": f"{y:.1f}", "r": "6"})


def _legend(root: ET.Element, page: PlanPage) -> None:
    for line, (name, text) in enumerate((("first", "first batch"), ("second", "second batch"))):
        y, right = 48 + 18 * line, page.width - 64
        ET.SubElement(root, "text", {"x": f"{right - 44:.0f}", "y": f"{y}"}).text = text
        ET.SubElement(root, "path", {"class": name, "d": f"M{right - 36:.0f} {y - 4}h36"})
