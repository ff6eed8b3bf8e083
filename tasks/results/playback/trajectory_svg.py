"""Draws the paths of failed episodes on the floor plan of their world."""

import re
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from specs.data.episode import EpisodeResult, reason
from specs.data.outcome_reasons import mark_of
from tasks.results.playback.plan_scale import draw_over, plan_page

_NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")


def failure_map_svg(plan: str, failures: Sequence[tuple[str, EpisodeResult]]) -> str:
    """Returns the plan with the path of every failure, a cross where it ended, and job and reason as tooltip.

    Args:
        plan: A floor plan as the export writes it.
        failures: Job ids and their results; those without a trajectory are left out.

    Raises:
        ValueError: The plan does not say its scale.
    """
    page = plan_page(plan)
    overlay = ET.Element("g", {"class": "failures", "fill": "none", "stroke-width": "2.5", "stroke-linejoin": "round"})
    for job, result in failures:
        if result.trajectory:
            points = [page.at((x_m, y_m)) for _, x_m, y_m, _ in result.trajectory]
            _path(overlay, f"{job}: {reason(result)}", mark_of(reason(result)).plan, points)
    return draw_over(plan, overlay)


def _path(parent: ET.Element, title: str, color: str, points: Sequence[tuple[float, float]]) -> None:
    group = ET.SubElement(parent, "g", {"stroke": color})
    ET.SubElement(group, "title").text = _NOT_XML.sub("\ufffd", title)
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    ET.SubElement(group, "polyline", {"points": line, "stroke-opacity": "0.75"})
    x, y = points[-1]
    ET.SubElement(group, "path", {"d": f"M{x:.1f} {y:.1f}m-6 -6l12 12m0 -12l-12 12", "stroke-width": "3"})
