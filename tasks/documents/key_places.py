"""Where keys stand in a document, read from its models; and a sample of what a key holds."""

from collections.abc import Iterable, Iterator, Mapping
from functools import lru_cache
from typing import Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel

from specs.rules import JsonOf

Place = tuple[str | int, ...]
"""Keys, indices and tags from the top of a document, as pydantic's errors have them."""

_MOST_KEYS = 3
_SAMPLE_DEPTH = 3


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
