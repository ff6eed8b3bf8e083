"""The templates that world generation is measured with: RoboMaker's ten samples and two homes with wishes."""

import json

from benchmarks.harness import ROOT
from specs.template.body import TemplateBody, template_body

HOMES = ("one-bedroom-house", "six-room-flat")
SAMPLES = tuple(
    sorted(path.name.removesuffix(".body.json") for path in (ROOT / "tests/worlds/data").glob("*.body.json"))
)
SPEED_TEMPLATES = ("two-rooms", *HOMES)
AIMS_PER_S = dict(zip(SPEED_TEMPLATES, (300, 120, 100), strict=True))
"""Worlds a second on two cores that issue 19 aims at."""


def read_template(name: str) -> TemplateBody:
    """Returns a template of this benchmark."""
    path = ROOT / (f"benchmarks/templates/{name}.json" if name in HOMES else f"tests/worlds/data/{name}.body.json")
    return template_body(json.loads(path.read_text()))
