"""Unions whose member is chosen by the shape of the data, so that a fault speaks of one member and not of all."""

from typing import Any, cast

from pydantic import Discriminator, Tag

from specs.base import Spec
from specs.rules import RULE

Sign = str | type | tuple[type, ...] | frozenset[str]


def member(name: str) -> Tag:
    """Returns the tag of a union's member; the brackets tell it from a key of the document."""
    return Tag(f"<{name}>")


def by_shape(allowed: str, **members: Sign) -> Discriminator:
    """Returns a discriminator that chooses a union's member by how the data looks.

    Args:
        allowed: What may stand here, in plain words, for data that looks like no member.
        members: For each member, its sign: a key that only it has, the Python types of its JSON data, or
            the only texts that it may be.
    """

    def choose(data: Any) -> str | None:  # noqa: ANN401 - raw data
        names = (name for name, sign in members.items() if _looks_like(data, name, sign))
        return next((f"<{name}>" for name in names), None)

    return Discriminator(choose, custom_error_type=RULE, custom_error_message=cast("Any", allowed))


def _looks_like(data: object, name: str, sign: Sign) -> bool:
    if isinstance(data, Spec):
        return type(data).__name__ == name
    if isinstance(sign, str):
        return isinstance(data, dict) and sign in data
    if isinstance(sign, frozenset):
        return isinstance(data, str) and data in sign
    return isinstance(data, sign) and not isinstance(data, bool)
