"""Where keys stand in a document, read from its models, and how a value of the wrong shape is written."""

import json
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel, ValidationError

from specs.rules import JsonOf, nearest_name

Place = tuple[str | int, ...]
"""Keys, indices and tags from the top of a document, as pydantic's errors have them."""

_MOST_KEYS = 3
_SAMPLE_DEPTH = 3
_PART_OF_A_KEY = 4
_NEARLY_THE_SAME = 0.85
_ALIKE = 0.65
_LONGEST_QUOTE = 40
_NUMBER_FIRST = re.compile(r"\s*([-+]?[0-9]+(?:\.[0-9]+)?)\s*([A-Za-z%°²³/]+[23]?)?\s*\Z")
# What one of a unit is in the unit that documents have: metres, seconds, radians, and shares of 1.
_UNITS = {
    "%": 0.01,
    **dict.fromkeys(("ms", "milliseconds"), 0.001),
    **dict.fromkeys(("min", "mins", "minute", "minutes"), 60.0),
    **dict.fromkeys(("h", "hour", "hours"), 3600.0),
    **dict.fromkeys(("d", "day", "days"), 86_400.0),
    **dict.fromkeys(("mm", "millimetres"), 0.001),
    **dict.fromkeys(("cm", "centimetres"), 0.01),
    **dict.fromkeys(("km", "kilometres"), 1000.0),
    **dict.fromkeys(("deg", "degree", "degrees", "°"), math.pi / 180.0),
    **dict.fromkeys(("km/h", "kmh", "kph"), 1 / 3.6),
    "cm/s": 0.01,
    "mm/s": 0.001,
    "deg/s": math.pi / 180.0,
    "g": 0.001,
}


class KeyPlace(NamedTuple):
    """Where a key may stand.

    Attributes:
        keys: From the top of the document to the key itself.
        lists: Which of these hold lists.
        sample: What the key holds, in short.
    """

    keys: tuple[str, ...]
    lists: tuple[bool, ...]
    sample: str


def is_tag(step: str) -> bool:
    """Returns whether a step of a place names a member of a union, or a key itself, rather than what is below a key."""
    return step == "[key]" or (step.startswith("<") and step.endswith(">"))


def models_in(annotation: Any) -> list[type[BaseModel]]:  # noqa: ANN401 - any type expression
    """Returns the models that a type mentions."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in models_in(part)]


def models_at(model: type[BaseModel], place: Place) -> list[type[BaseModel]]:
    """Returns the models that an object at a place in a document may be of."""
    models = [model]
    for step in place:
        if isinstance(step, int):
            continue
        if is_tag(step):
            models = [one for one in models if f"<{one.__name__}>" == step] or models
        else:
            fields = [one.model_fields[step] for one in models if step in one.model_fields]
            below = [one for field in fields for one in models_in(field.annotation)]
            models = below or [one for field in fields for one in _models_as_json(field.annotation)] or models
    return models


def _models_as_json(annotation: Any) -> list[type[BaseModel]]:  # noqa: ANN401 - any type expression
    """Returns the models whose documents a type takes as text."""
    if isinstance(annotation, JsonOf):
        return [annotation.model]
    return [model for part in get_args(annotation) for model in _models_as_json(part)]


def known_keys(model: type[BaseModel], place: Place) -> list[str]:
    """Returns the keys that an object at a place in a document may have."""
    return list(dict.fromkeys(name for one in models_at(model, place) for name in one.model_fields))


def known_place(model: type[BaseModel], place: Place) -> tuple[str, ...]:
    """Returns the keys of a place that the models know: no indices, no tags, nothing of a wrapper around it."""
    found: list[str] = []
    for step in place:
        if isinstance(step, str) and not is_tag(step) and step in known_keys(model, tuple(found)):
            found.append(step)
    return tuple(found)


@lru_cache(maxsize=16)
def key_places(model: type[BaseModel]) -> Mapping[str, tuple[KeyPlace, ...]]:
    """Returns where each key of a document may stand, by the key in small letters."""
    found: dict[str, list[KeyPlace]] = {}
    for place in _walk(model, (), (), ()):
        found.setdefault(place.keys[-1].lower(), []).append(place)
    return {key: tuple(dict.fromkeys(places)) for key, places in found.items()}


def _walk(
    model: type[BaseModel], keys: tuple[str, ...], lists: tuple[bool, ...], above: tuple[type[BaseModel], ...]
) -> Iterator[KeyPlace]:
    for name, field in model.model_fields.items():
        place = KeyPlace((*keys, name), (*lists, is_list(field.annotation)), sample(field.annotation))
        yield place
        if not _is_mapping(field.annotation):
            for below in models_in(field.annotation):
                if below not in (*above, model):
                    yield from _walk(below, place.keys, place.lists, (*above, model))


def is_list(annotation: Any) -> bool:  # noqa: ANN401 - any type expression
    """Returns whether what a type describes may be a list."""
    return get_origin(annotation) in (tuple, list) or any(is_list(part) for part in _members(annotation))


def takes_text(annotation: Any) -> bool:  # noqa: ANN401 - any type expression
    """Returns whether what a type describes may be any text."""
    return annotation is str or any(takes_text(part) for part in _members(annotation))


def sample(annotation: Any, depth: int = _SAMPLE_DEPTH) -> str:  # noqa: ANN401 - any type expression
    """Returns what a type describes in short, such as ``{Area: ..., AspectRatio: {...}}`` or ``[...]``."""
    models = models_in(annotation)
    inside = object_sample(models[0], depth) if len(models) == 1 and not _is_mapping(annotation) else "..."
    if is_list(annotation):
        return f"[{inside}]"
    return inside


def object_sample(model: type[BaseModel], depth: int = _SAMPLE_DEPTH) -> str:
    """Returns an object in short: the keys that it needs, or the first that it may have."""
    if depth <= 1:
        return "{...}"
    fields = model.model_fields
    needed = [name for name in fields if fields[name].is_required()]
    below = depth - 1 if needed or len(fields) == 1 else 1
    keys = needed or list(fields)[:_MOST_KEYS]
    return f"{{{', '.join(f'{key}: {sample(fields[key].annotation, below)}' for key in keys)}}}"


def _is_mapping(annotation: Any) -> bool:  # noqa: ANN401 - any type expression
    return get_origin(annotation) is dict or any(_is_mapping(part) for part in _members(annotation))


def _members(annotation: Any) -> Iterable[Any]:  # noqa: ANN401 - any type expression
    """Returns the parts of a union or of an annotated type; none for others, such as a list."""
    inside = get_origin(annotation) in (tuple, list, dict) or isinstance(annotation, type)
    return () if inside else get_args(annotation)


def unknown_key_text(model: type[BaseModel], place: Place) -> str:
    """Returns what to write instead of a key that an object does not have.

    Args:
        model: What the document is.
        place: Where the key stands, the key last.
    """
    key, known = str(place[-1]), known_keys(model, place[:-1])
    here = known_place(model, place[:-1])
    meant, elsewhere = meant_key(model, place)
    if not (meant or elsewhere):
        near = key_places(model).get(nearest_name(key, key_places(model), _NEARLY_THE_SAME), ())
        # Another section's key is meant only by its whole name.
        elsewhere = _belongs(tuple(place for place in near if place.keys[:1] == here[:1] or not here), here)
    hints = [f'did you mean "{meant}"? '] if meant else []
    hints += [f"{'or ' if meant else ''}{elsewhere}; "] if elsewhere else []
    hint = "".join(hints)
    if not hint and here and len(known) == 1:
        models = models_at(model, place[:-1])
        return f"the only known key is {known[0]}; write {_key_of(place[:-1])}: {object_sample(models[0])}"
    keys = f"known keys{' here' if elsewhere else ''} are {', '.join(known)}" if known else "no such key"
    return f"{hint}{keys}"


def meant_key(model: type[BaseModel], place: Place) -> tuple[str, str]:
    """Returns which known key an unknown one stands for, and where it belongs else; both may be empty.

    Args:
        model: What the document is.
        place: Where the key stands, the key last.
    """
    key, known = str(place[-1]), known_keys(model, place[:-1])
    meant = same_word(key, known) or _containing(key, known)
    elsewhere = "" if meant else _belongs(key_places(model).get(key.lower(), ()), known_place(model, place[:-1]))
    meant = meant or same_word(key.removesuffix("s"), known) or same_word(f"{key}s", known)
    return meant or ("" if elsewhere else nearest_name(key, known, _ALIKE)), elsewhere


def meant_text(text: str, known: Iterable[str]) -> str:
    """Returns the question whether one of the known words is meant, with a space behind it; else nothing."""
    words = list(known)
    meant = same_word(text, words) or _containing(text, words) or nearest_name(text, words)
    return f'did you mean "{meant}"? ' if meant else ""


def same_word(text: str, known: Iterable[str]) -> str:
    """Returns the known word that differs in capitals, spaces and joints alone; else nothing."""
    plain = _plain(text)
    return next((word for word in known if _plain(word) == plain), "")


def list_text(model: type[BaseModel], place: Place, value: object) -> str:
    """Returns how a list is written where something else stands."""
    key, inside = _key_of(place), _one_model(model, place)
    if isinstance(value, str | int | float) and not isinstance(value, bool) and inside is None:
        item = value if isinstance(value, str) or not _lists_text(model, place) else f"{value}"
        quoted = json.dumps(item, ensure_ascii=False)
        return f"a list; write {key}: [{quoted if len(quoted) <= _LONGEST_QUOTE else '...'}]"
    if inside is None:
        return "a list"
    if isinstance(value, dict) and any(same_word(each, inside.model_fields) for each in value):
        return f"a list; write {key}: [{{...}}], with [ ] around what stands there, or - before it in YAML"
    return f"a list; write {key}: [{object_sample(inside)}]"


def object_text(model: type[BaseModel], place: Place, value: object) -> str:
    """Returns how an object is written where something else stands."""
    known = known_keys(model, place)
    if not known:
        return "an object"
    told = f"an object with keys {', '.join(known)}"
    models = models_at(model, place)
    if len(models) != 1 or not place:
        return told
    return f"{told}; {_object_hint(models[0], place, value)}"


def number_text(value: object, place: Place = (), kind: str = "a number") -> str:
    """Returns what is wrong with text where a number belongs, and the number to write.

    Args:
        value: The text.
        place: Where it stands.
        kind: What belongs there.
    """
    found = _NUMBER_FIRST.match(value) if isinstance(value, str) else None
    if not found:
        return kind
    number, unit = found.groups()
    factor = _UNITS.get((unit or "").lower(), 1.0)
    if (unit == "%" and _key_of(place).endswith("Percentage")) or (unit == "ms" and _key_of(place).endswith("_ms")):
        factor = 1.0
    written = f"{round(float(number) * factor, 6):.12g}" if factor != 1.0 else number
    if kind != "a number" and not re.fullmatch(r"[-+]?[0-9]+", written):
        return kind
    if factor != 1.0:
        return f"{kind}; write {written} for {number} {unit}"
    return f"{kind}; write {written}, without {'its unit' if unit else 'quotes'}"


def missing_text(model: type[BaseModel], place: Place) -> str:
    """Returns what to write where a key is missing that is needed."""
    key = str(place[-1])
    fields = [one.model_fields[key] for one in models_at(model, place[:-1]) if key in one.model_fields]
    annotations = [each.annotation for each in fields if models_in(each.annotation) and not takes_text(each.annotation)]
    told = sample(annotations[0]) if len(annotations) == 1 else "..."
    return "required" if told == "..." else f"required; write {key}: {told}"


def _belongs(places: tuple[KeyPlace, ...], here: tuple[str, ...]) -> str:
    """Returns where a key belongs, as seen from an object: the nearest of its places, if one is the nearest."""
    ranked = sorted(places, key=lambda place: _rank(place, here))
    if not ranked or (len(ranked) > 1 and _rank(ranked[0], here) == _rank(ranked[1], here)):
        return ""
    place = ranked[0]
    shared = _shared(place.keys[:-1], here)
    parent = ".".join(f"{key}[]" if many else key for key, many in zip(place.keys[:-1], place.lists[:-1], strict=True))
    beside = f"{here[shared]}: {{...}}, " if shared < len(here) else ""
    return f"it belongs in {parent or 'the top of the document'}, as {beside}{_nested(place, shared)}"


def _rank(place: KeyPlace, here: tuple[str, ...]) -> tuple[int, int]:
    """Returns how far a place is: first whether one goes up for it, and how far, then how far down."""
    shared = _shared(place.keys[:-1], here)
    return len(here) - shared, len(place.keys) - shared


def _shared(keys: tuple[str, ...], here: tuple[str, ...]) -> int:
    """Returns how many keys from the top two places have in common."""
    return next(
        (n for n, (one, other) in enumerate(zip(keys, here, strict=False)) if one != other), min(len(keys), len(here))
    )


def _nested(place: KeyPlace, first: int) -> str:
    """Returns the keys of a place, from the first one wanted, each inside the one before."""
    text = f"{place.keys[-1]}: {place.sample}"
    for key, many in reversed(list(zip(place.keys[first:-1], place.lists[first:-1], strict=True))):
        text = f"{key}: [{{{text}}}]" if many else f"{key}: {{{text}}}"
    return text


def _object_hint(model: type[BaseModel], place: Place, value: object) -> str:
    key = _key_of(place)
    if isinstance(place[-1], int):
        return f"write {object_sample(model)}"
    if (
        isinstance(value, list)
        and len(value) == 1
        and isinstance(value[0], dict)
        and set(value[0]) <= set(model.model_fields)
    ):
        return f"write {key}: {{...}}, without the [ ] or the - around it"
    taker = _taker(model, value)
    return f"write {key}: {{{taker}: {json.dumps(value)}}}" if taker else f"write {key}: {object_sample(model)}"


def _taker(model: type[BaseModel], value: object) -> str:
    """Returns the key that makes an object of numbers that stand alone; empty if none does by itself."""
    numbers = value if isinstance(value, list) and value else [value]
    if not all(isinstance(each, int | float) and not isinstance(each, bool) for each in numbers):
        return ""
    needed = [name for name, field in model.model_fields.items() if field.is_required()]
    for name in needed[:2] if needed else model.model_fields:
        try:
            model.model_validate({name: value})
        except ValidationError:
            continue
        return name
    return ""


def _lists_text(model: type[BaseModel], place: Place) -> bool:
    """Returns whether the lists at a place hold texts alone."""
    known = known_place(model, place)
    parents = models_at(model, known[:-1]) if known else []
    annotations: list[Any] = [
        one.model_fields[known[-1]].annotation for one in parents if known[-1] in one.model_fields
    ]
    return bool(annotations) and all(map(_holds_text, annotations))


def _holds_text(annotation: Any) -> bool:  # noqa: ANN401 - any type expression
    origin, inside = get_origin(annotation), get_args(annotation)
    if origin is dict:
        return _holds_text(inside[1])
    if origin in (tuple, list):
        return takes_text(inside[0])
    return any(map(_holds_text, _members(annotation)))


def _key_of(place: Place) -> str:
    return next((step for step in reversed(place) if isinstance(step, str) and not step.startswith(("<", "["))), "")


def _one_model(model: type[BaseModel], place: Place) -> type[BaseModel] | None:
    """Returns the model of the objects of a list; None where it holds words or numbers, or objects of several kinds."""
    key = _key_of(place)
    parents = models_at(model, place[: max(n for n, step in enumerate(place) if step == key)]) if key else []
    annotations: list[Any] = [one.model_fields[key].annotation for one in parents if key in one.model_fields]
    models = [each for annotation in annotations for each in models_in(annotation)]
    return models[0] if len(models) == 1 else None


def _containing(key: str, known: Iterable[str]) -> str:
    """Returns the one known key that has this one in it, or that is in it."""
    if len(key) < _PART_OF_A_KEY:
        return ""
    found = [one for one in known if _plain(key) in _plain(one)]
    return found[0] if len(found) == 1 else ""


def _plain(text: str) -> str:
    return re.sub(r"[\s_-]", "", text).lower()
