"""Worlds in the store: their one canonical form as bytes, and the one place that reads and writes them.

Equal worlds are equal bytes on any machine. A reference is ``<generation>/<world>``.
"""

import hashlib
import json
from collections.abc import Iterator, Sequence
from functools import lru_cache
from itertools import islice
from json.encoder import encode_basestring

from pydantic import ValidationError
from pydantic_core import to_json

from specs.arn import absence
from specs.data.world import Color, Furniture, Solid, World
from specs.errors import DocumentError, ObjectNotFound, ResourceNotFound, WorldChanged
from tasks.storage.base.keys import world_key
from tasks.storage.base.store import Store, create_once

_number_text = float.__repr__
_json_text = json.JSONEncoder(sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode


def encode_world(world: World) -> bytes:
    """Returns the canonical JSON of a world; decoding it gives the same world, whose floats were rounded when made.

    It is ``canonical_json(world.model_dump(mode="json"))``. Nearly all of a world is its solids and its map, so these
    are written here, each in one go.

    Raises:
        ValueError: For NaN or infinity, which JSON has no words for.
    """
    rest = world.model_dump(mode="json", exclude={"walls": True, "furniture": True, "map": {"runs"}})
    parts = {name: _json_text(value) for name, value in rest.items()}
    parts["map"] = f'{parts["map"][:-1]},"runs":{to_json(world.map.runs).decode()}}}'
    solids = [*world.walls, *[solid for piece in world.furniture for solid in piece.solids]]
    texts = iter(_solid_texts(solids))
    parts["walls"] = _solids_text(texts, world.walls)
    parts["furniture"] = f"[{','.join([_furniture_text(piece, texts) for piece in world.furniture])}]"
    return f"{{{','.join([f'{_json_text(name)}:{parts[name]}' for name in sorted(parts)])}}}".encode()


def _furniture_text(piece: Furniture, texts: Iterator[str]) -> str:
    return (
        f'{{"center_m":{_numbers_text(piece.center_m)},"model_type":{encode_basestring(piece.model_type)},'
        f'"name":{encode_basestring(piece.name)},"room":{encode_basestring(piece.room)},'
        f'"solids":{_solids_text(texts, piece.solids)},"yaw_rad":{_finite(_number_text(piece.yaw_rad))}}}'
    )


def _solids_text(texts: Iterator[str], solids: tuple[Solid, ...]) -> str:
    """Returns the next texts, one for each solid, as a list."""
    return f"[{','.join(islice(texts, len(solids)))}]"


def _solid_texts(solids: Sequence[Solid]) -> list[str]:
    """Returns the text of each solid."""
    centers = _row_texts([solid.center_m for solid in solids])
    yaws = _row_texts([(solid.yaw_rad,) for solid in solids])
    return [
        f'{{"center_m":[{center}],{_paint_text(solid.color, solid.half_extents_m)},'
        f'"name":{encode_basestring(solid.name)},{_outline_text(solid)}"shape":"{solid.shape}","yaw_rad":{yaw}}}'
        for solid, center, yaw in zip(solids, centers, yaws, strict=True)
    ]


def _outline_text(solid: Solid) -> str:
    corners = solid.outline_m
    return "" if corners is None else f'"outline_m":[{",".join([_numbers_text(corner) for corner in corners])}],'


def _row_texts(rows: Sequence[tuple[float, ...]]) -> list[str]:
    """Returns the numbers of each row with commas between them.

    Pydantic writes them five times as fast as Python and with the same digits, but for numbers that Python writes with
    an exponent. These have another letter, or so many zeros.
    """
    text = to_json(rows).decode()
    if any(sign in text for sign in ("e", "N", "I", "0.0000")):
        return [_numbers_text(row)[1:-1] for row in rows]
    return text[2:-2].split("],[") if rows else []


def _paint_text(color: Color, half_extents_m: tuple[float, float, float]) -> str:
    """Returns what many solids share; zeros have a sign, which the memory of texts does not see."""
    if 0.0 in color or 0.0 in half_extents_m:
        return _paint(color, half_extents_m)
    return _known_paint(color, half_extents_m)


def _paint(color: Color, half_extents_m: tuple[float, float, float]) -> str:
    return f'"color":{_numbers_text(color)},"half_extents_m":{_numbers_text(half_extents_m)}'


_known_paint = lru_cache(maxsize=8192)(_paint)


def _numbers_text(numbers: tuple[float, ...]) -> str:
    return _finite(f"[{','.join(map(_number_text, numbers))}]")


def _finite(text: str) -> str:
    """Returns the text of numbers as it is, unless it says nan or inf."""
    if "n" in text:
        raise ValueError(f"JSON has no words for {text}")
    return text


def decode_world(body: bytes) -> World:
    """Returns the world that the bytes hold.

    Raises:
        pydantic.ValidationError: They hold something else.
    """
    return World.model_validate_json(body)


def reference_key(reference: str) -> str:
    """Returns the key of a world.

    Raises:
        DocumentError: The reference is none.
    """
    generation, _, name = reference.partition("/")
    return world_key(generation, name)


def world_bytes(store: Store, reference: str) -> bytes:
    """Returns the document of a world, whatever it is.

    Raises:
        ObjectNotFound: There is no such world.
    """
    return store.get(reference_key(reference)).body


def pinned_world_bytes(store: Store, reference: str, sha256: str) -> bytes:
    """Returns the document of a world that has the digest.

    Raises:
        ObjectNotFound: There is no such world.
        WorldChanged: It has another digest.
    """
    body = world_bytes(store, reference)
    if hashlib.sha256(body).hexdigest() != sha256:
        raise WorldChanged(reference)
    return body


def read_world(store: Store, reference: str, source: str) -> World:
    """Returns a world.

    Args:
        store: Where it is.
        reference: Which one.
        source: Who asks, for the error.

    Raises:
        ResourceNotFound: There is no such world.
        DocumentError: What is there was not written by this version of Simyard.
    """
    try:
        return decode_world(world_bytes(store, reference))
    except ObjectNotFound as exc:
        raise ResourceNotFound.of("worlds", reference, absence(["world"], store.url), source=source) from exc
    except ValidationError as exc:
        raise DocumentError.of(
            "worlds", reference, "a world that this version of Simyard wrote", source=store.url
        ) from exc


def write_world(store: Store, reference: str, body: bytes) -> None:
    """Puts the document of a world into the store; the same one may be there already.

    Raises:
        ObjectExists: Another one is there.
    """
    create_once(store, reference_key(reference), body)
