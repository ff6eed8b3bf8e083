"""The lists and pictures of docs/reference/templates.md, written from the code.

`.venv/bin/python -m tests.docs.template_page` writes them; the tests compare.
"""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, cast, get_args

from flows.preview.world_preview import (
    FURNITURE_KINDS,
    FurnitureKind,
    WorldRequest,
    furniture_kinds,
    furniture_picture,
    make_world,
    size_text,
)
from specs.data.world import ROBOT_RADIUS_M, RoomType
from specs.template.body import TemplateBody
from tasks.documents.parse import parse
from tasks.documents.source_text import read_document
from tasks.export.drawing.floor_plan import floor_plan_svg
from tests.docs.template_notes import NOTES
from tests.docs.tree import between
from tests.repository import ROOT

PAGE = ROOT / "docs/reference/templates.md"
PICTURES = ROOT / "docs/pictures/templates"
FURNITURE = ROOT / "docs/pictures/furniture"
EXAMPLES = ("studio", "family-flat", "office")
EXAMPLE_SEED = 1
GROUND = '<rect width="100%" height="100%" fill="#fff"/>'
_LONG_LIST = 10
_KEY_WIDTH, _TYPE_WIDTH = 38, 62

Schema = dict[str, Any]
Key = tuple[str, ...]


def keys() -> dict[Key, Schema]:
    """Returns the schema of every key, by its nesting."""
    schema = TemplateBody.model_json_schema()
    return dict(_walk(schema, cast("dict[str, Schema]", schema["$defs"]), ()))


def lists() -> Mapping[str, str]:
    """Returns what stands in the page between ``<!-- name -->`` and ``<!-- end of name -->``, by name."""
    return {"keys": _tree(), "meanings": _meanings(), "furniture": _furniture()}


def pictures() -> Mapping[Path, str]:
    """Returns every picture of the page."""
    plans = {PICTURES / f"{name}.svg": _plan(name) for name in EXAMPLES}
    pieces = {FURNITURE / f"{kind}.svg": _on_ground(furniture_picture(kind)) for kind in FURNITURE_KINDS}
    return {**plans, **pieces}


def example(name: str) -> TemplateBody:
    """Returns one of the complete examples."""
    path = ROOT / f"examples/templates/{name}.yaml"
    return parse(TemplateBody, read_document(path), str(path))


def write() -> None:
    """Writes the lists into the page, and the pictures beside it."""
    page = PAGE.read_text()
    for name, text in lists().items():
        page = page.replace(f"<!-- {name} -->\n{between(page, name)}", f"<!-- {name} -->\n{text}")
    PAGE.write_text(page)
    for path, drawing in pictures().items():
        path.parent.mkdir(exist_ok=True)
        path.write_text(drawing)


def _plan(name: str) -> str:
    world = make_world(example(name), WorldRequest(EXAMPLE_SEED, ROBOT_RADIUS_M), 1, 1)
    return _on_ground(floor_plan_svg(world))


def _on_ground(drawing: str) -> str:
    """Returns a drawing with a white ground, which pages that are dark show, too."""
    before, style, rest = drawing.partition("</style>")
    return f"{before}{style}{GROUND}{rest}"


def _walk(schema: Schema, models: dict[str, Schema], above: Key) -> Iterator[tuple[Key, Schema]]:
    needed = schema.get("required", [])
    for name, field in schema.get("properties", {}).items():
        yield (*above, name), {"told": "needed" if name in needed else "", **field}
        below = list(_references(field))
        for reference in below:
            for key, inside in _walk(models[reference], models, (*above, name)):
                either = len(below) > 1 and len(key) == len(above) + 2
                yield key, {**inside, "told": "one of the two"} if either else inside


def _references(schema: Schema) -> Iterator[str]:
    if "$ref" in schema:
        yield schema["$ref"].rpartition("/")[2]
    for part in (*schema.get("anyOf", ()), *schema.get("oneOf", ()), *([schema["items"]] if "items" in schema else [])):
        yield from _references(part)


def _tree() -> str:
    lines = [_tree_line(key, schema) for key, schema in keys().items()]
    return "```text\n" + "\n".join(lines) + "\n```\n"


def _tree_line(key: Key, schema: Schema) -> str:
    label = "  " * (len(key) - 1) + key[-1] + ("[]" if schema.get("type") == "array" else "")
    return f"{label:<{_KEY_WIDTH}} {_type(schema):<{_TYPE_WIDTH}} {_default(schema)}".rstrip()


def _type(schema: Schema) -> str:
    """Returns what may stand behind a key."""
    kind = schema.get("type")
    if kind == "array":
        return f"{_count(schema)} {_items(schema['items'], one=schema.get('maxItems') == 1)}".strip()
    if "enum" in schema or "const" in schema:
        return _words(schema.get("enum") or [schema["const"]])
    if kind == "number":
        return f"number {schema['minimum']:g} to {schema['maximum']:g}"
    if kind == "string":
        longest = schema.get("maxLength")
        return f"text of 1 to {longest} letters, digits, spaces, _ and -" if longest else "text"
    options = [each for each in (*schema.get("anyOf", ()), *schema.get("oneOf", ())) if each.get("type") != "null"]
    return " or ".join(dict.fromkeys(_type(each) for each in options)) or "object"


def _items(schema: Schema, *, one: bool) -> str:
    if "$ref" in schema:
        return "object" if one else "objects"
    words = schema.get("enum", [])
    if words == list(get_args(RoomType)):
        return "types of rooms, as in Rooms"
    return "kinds of furniture, see below" if len(words) > _LONG_LIST else _words(words) if words else "texts"


def _words(words: list[str]) -> str:
    return ", ".join(f'"{word}"' if word.isdigit() else word for word in words)


def _count(schema: Schema) -> str:
    least, most = schema.get("minItems", 0), schema.get("maxItems")
    if most is None:
        return f"{least} or more"
    return f"exactly {most}" if least == most else f"{least} to {most}"


def _default(schema: Schema) -> str:
    """Returns whether a key is needed, or what stands there when it is left out."""
    if schema["told"]:
        return cast("str", schema["told"])
    default = schema.get("default")
    if isinstance(default, list) and default:
        return ""
    if isinstance(default, dict):
        return "" if any(isinstance(below, dict | list) for below in default.values()) else _flow(default)
    return "" if default is None or default == [] else _flow(default)


def _flow(value: object) -> str:
    if isinstance(value, dict):
        fields = cast("dict[str, object]", value)
        return f"{{{', '.join(f'{key}: {_flow(below)}' for key, below in fields.items())}}}"
    return f"{value:g}" if isinstance(value, float) else json.dumps(value).strip('"') if value != "1" else '"1"'


def note_of(key: Key) -> Key:
    """Returns the name under which the notes have a key: with the key above it where that makes a difference."""
    return key[-2:] if key[-2:] in NOTES else key[-1:]


def _meanings() -> str:
    rows = ["| key | what it says | what Simyard makes of it |", "|---|---|---|"]
    noted: dict[Key, Schema] = {}
    for key, schema in keys().items():
        noted.setdefault(note_of(key), schema)
    rows += [f"| `{'.'.join(key)}` | {schema['description']} | {NOTES[key]} |" for key, schema in noted.items()]
    return "\n" + "\n".join(rows) + "\n\n"


def _furniture() -> str:
    rows = [
        "| kind | | size: width, depth, height (m) | free floor (m) | stands | in rooms that list nothing |",
        "|---|---|---|---:|---|---|",
    ]
    rows += [_furniture_row(each) for each in furniture_kinds()]
    return "\n" + "\n".join(rows) + "\n\n"


def _furniture_row(kind: FurnitureKind) -> str:
    size = " x ".join(size_text(each) for each in (kind.width_m, kind.depth_m, kind.height_m))
    rooms = [
        f"{word} {', '.join(names)}"
        for word, names in (("first in", kind.essential), ("often in", kind.likely), ("at times in", kind.occasional))
        if names
    ]
    picture = f"![{kind.kind}](../pictures/furniture/{kind.kind}.svg)"
    told = "; ".join(rooms) or "with what it stands near"
    return f"| `{kind.kind}` | {picture} | {size} | {kind.clear_m:g} | {kind.stands} | {told} |"


if __name__ == "__main__":
    write()
