"""The certificate that docs/guide/worlds.md shows: of the world that its preview command draws."""

import json

from pydantic import JsonValue

from benchmarks.worlds.world_templates import read_template
from tasks.worlds.generate import generate_world

TEMPLATE, SEED = "two-rooms", 15
_WIDTH = 128


def example_certificate() -> str:
    """Returns the certificate as a block of JSON, what fits into a line on a line."""
    world = generate_world(
        read_template(TEMPLATE), seed=SEED, generation="preview", floorplan_index=1, interior_index=1
    )
    return f"```json\n{_lines(world.certificate.model_dump(mode='json'), 0)}\n```"


def _lines(data: JsonValue, indent: int) -> str:
    line = json.dumps(data)
    if not isinstance(data, dict | list) or (indent and indent + len(line) <= _WIDTH):
        return line
    named = data.items() if isinstance(data, dict) else (("", each) for each in data)
    parts = [(f"{json.dumps(name)}: " if name else "") + _lines(each, indent + 2) for name, each in named]
    inside = ",\n".join(" " * (indent + 2) + part for part in parts)
    begin, end = "{}" if isinstance(data, dict) else "[]"
    return f"{begin}\n{inside}\n{' ' * indent}{end}"
