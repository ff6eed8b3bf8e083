"""Says where a key belongs, and how a value of the wrong shape is written."""

import json
import re
from collections.abc import Iterable
from typing import Any

from pydantic import BaseModel

from specs.rules import nearest
from tasks.documents.key_places import (
    KeyPlace,
    Place,
    key_places,
    known_keys,
    known_place,
    models_at,
    models_in,
    object_sample,
    sample,
    takes_text,
)

_PART_OF_A_KEY = 4
_NEARLY_THE_SAME = 0.85
_LONGEST_QUOTE = 40
_NUMBER_FIRST = re.compile(r"\s*([-+]?[0-9]+(?:\.[0-9]+)?)\s*([A-Za-z%°²³]+[23]?)?\s*\Z")


def unknown_key_text(model: type[BaseModel], place: Place) -> str:
    """Returns what to write instead of a key that an object does not have.

    Args:
        model: What the document is.
        place: Where the key stands, the key last.
    """
    key, known = str(place[-1]), known_keys(model, place[:-1])
    here = known_place(model, place[:-1])
    meant = same_word(key, known) or _containing(key, known)
    elsewhere = "" if meant else _belongs(key_places(model).get(key.lower(), ()), here)
    if not (meant or elsewhere):
        meant = nearest(key, known)
    if not (meant or elsewhere):
        near = nearest(key, key_places(model), _NEARLY_THE_SAME)
        elsewhere = _belongs(key_places(model).get(near, ()), here)
    hint = f'did you mean "{meant}"? ' if meant else f"{elsewhere}; " if elsewhere else ""
    if not hint and here and len(known) == 1:
        models = models_at(model, place[:-1])
        return f"the only known key is {known[0]}; write {_key_of(place[:-1])}: {object_sample(models[0])}"
    keys = f"known keys{' here' if elsewhere else ''} are {', '.join(known)}" if known else "no such key"
    return f"{hint}{keys}"


def meant_text(text: str, known: Iterable[str]) -> str:
    """Returns the question whether one of the known words is meant, with a space behind it; else nothing."""
    words = list(known)
    meant = same_word(text, words) or nearest(text, words)
    return f'did you mean "{meant}"? ' if meant else ""


def same_word(text: str, known: Iterable[str]) -> str:
    """Returns the known word that differs in capitals, spaces and joints alone; else nothing."""
    plain = _plain(text)
    return next((word for word in known if _plain(word) == plain), "")


def list_text(model: type[BaseModel], place: Place, value: object) -> str:
    """Returns how a list is written where something else stands."""
    key, inside = _key_of(place), _one_model(model, place)
    if isinstance(value, str | int | float) and not isinstance(value, bool) and inside is None:
        quoted = json.dumps(value, ensure_ascii=False)
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


def number_text(value: object) -> str:
    """Returns what is wrong with text where a number belongs."""
    found = _NUMBER_FIRST.match(value) if isinstance(value, str) else None
    if not found:
        return "a number"
    number, rest = found.groups()
    return f"a number; write {number}, without {'its unit' if rest else 'quotes'}"


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
    only = next(iter(model.model_fields)) if len(model.model_fields) == 1 else ""
    if only and isinstance(value, int | float) and not isinstance(value, bool):
        return f"write {key}: {{{only}: {value}}}"
    return f"write {key}: {object_sample(model)}"


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
