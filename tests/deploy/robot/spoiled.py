"""What somebody makes of objects who can write to the store and wants to end the robot's agent."""

import json
from collections.abc import Callable
from random import Random

BIG_BYTES = 50 << 20
_NUMBERS = ["-1", "9" * 19, "9007199254740993", "9" * 400, "9" * 4300, "9" * 5000, "1e999", "NaN", "Infinity", "-0.0"]
_JUNK: list[object] = [
    None,
    True,
    -1,
    1.5,
    "",
    "x" * 5000,
    [],
    {},
    [[]],
    {"a": {"b": []}},
    "\ud800",
    "\0",
    "../..",
    "a\nb",
]


def spoil(body: bytes, dice: Random) -> bytes:
    """Returns an object's bytes, spoiled in one of many ways."""
    return dice.choice(_WAYS)(body, dice)


def _cut(body: bytes, dice: Random) -> bytes:
    return body[: dice.randrange(len(body) + 1)]


def _flip(body: bytes, dice: Random) -> bytes:
    changed = bytearray(body)
    for _ in range(dice.randint(1, 4)):
        changed[dice.randrange(len(changed))] ^= 1 << dice.randrange(8)
    return bytes(changed)


def _number(body: bytes, dice: Random) -> bytes:
    return _with_text(body, dice, dice.choice(_NUMBERS))


def _junk(body: bytes, dice: Random) -> bytes:
    return _with_text(body, dice, json.dumps(dice.choice(_JUNK)))


def _nest(body: bytes, dice: Random) -> bytes:
    depth = dice.choice([100, 1000, 100_000])
    opening, closing = dice.choice([("[", "]"), ('{"a":', "}")])
    return _with_text(body, dice, opening * depth + "1" + closing * depth)


def _raw_text(body: bytes, dice: Random) -> bytes:
    return _with_text(body, dice, dice.choice(['"\\ud800"', '"\\udc00\\ud800"', '"\\u0000"', '"\x01"', "'a'", "nul"]))


def _twice(body: bytes, dice: Random) -> bytes:
    document = json.loads(body)
    key = dice.choice(sorted(document))
    again = f"{json.dumps(key)}:{json.dumps(dice.choice(_JUNK))},"
    return b"{" + again.encode() + body.lstrip()[1:]


def _more(body: bytes, dice: Random) -> bytes:
    return body + dice.choice([b"x", b"}", b"\0" * 1000, b" " * (2 << 20), body])


def _nothing(_body: bytes, dice: Random) -> bytes:
    return dice.choice([b"", b"null", b"{}", b"[]", b"0", b"\xff\xfe", b"\xef\xbb\xbf{}", b'{"withdrawn":1}', b'""'])


def _with_text(body: bytes, dice: Random, text: str) -> bytes:
    """Returns a document in which one value, at any depth, is replaced by a text that need not be JSON."""
    document: object = json.loads(body)
    place, key = document, None
    while isinstance(place, dict | list) and place:
        keys: list[str | int] = list(place) if isinstance(place, dict) else list(range(len(place)))
        parent, key = place, dice.choice(keys)
        place = place[key]  # pyright: ignore[reportArgumentType, reportCallIssue, reportUnknownVariableType] - any JSON
        if dice.random() < 0.5:
            break
    if key is None:
        return text.encode()
    parent[key] = "HERE"  # pyright: ignore[reportArgumentType, reportCallIssue, reportPossiblyUnboundVariable] - any JSON
    return json.dumps(document).replace('"HERE"', text, 1).encode()


_WAYS: list[Callable[[bytes, Random], bytes]] = [
    _cut,
    _flip,
    _flip,
    _number,
    _number,
    _number,
    _junk,
    _junk,
    _nest,
    _raw_text,
    _twice,
    _more,
    _nothing,
]
