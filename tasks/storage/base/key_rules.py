"""What may stand in a key, and how a form of keys is filled."""

import re
from string import Formatter

from specs.base import Fault
from specs.errors import DocumentError

NAME_RULE = "1 to 64 of A-Z a-z 0-9 _ -, the first a letter or a digit"
KEY_RULE = "parts joined by /, none empty or beginning with a dot, at most 1024 bytes"
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_-]{0,63}")
_DIGEST = re.compile(r"[0-9a-f]{64}")
_FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]{0,127}")
_BUCKET = re.compile(r"(?!.*\.\.)[a-z0-9][a-z0-9.-]{1,61}[a-z0-9]")
_CONTROL = re.compile(r"[\x00-\x1f\x7f]")
_PARTS = {"digest": (_DIGEST, "64 lower-case hex digits"), "file": (_FILE, "a plain file name")}
"""What may stand in a part of a form, and the rule in words; in every other part, a name."""
_DIGITS = re.compile(r"[0-9]+")


def fill(form: str, **parts: str | int) -> str:
    """Returns the key of a form; the parts are text that is checked, or numbers.

    Raises:
        DocumentError: Text may not stand in its part.
    """
    return form.format(**{part: _part(part, text) for part, text in parts.items()})


def key_pattern(form: str, **known: str) -> re.Pattern[str]:
    """Returns what matches the keys of a form, with a group for each part.

    Args:
        form: The form.
        known: Regular expressions of parts that are narrower than the form itself says.
    """
    expression = ""
    for text, part, spec, _ in Formatter().parse(form):
        expression += re.escape(text)
        if part:
            broad = _DIGITS.pattern if spec else _PARTS[part][0].pattern if part in _PARTS else "[^/]+"
            expression += f"(?P<{part}>{known.get(part, broad)})"
    return re.compile(expression)


def _part(part: str, text: str | int) -> str | int:
    if isinstance(text, int):
        return text
    pattern, rule = _PARTS.get(part, (_NAME, NAME_RULE))
    return _match(pattern, text, part, rule)


def folder(form: str, **parts: str) -> str:
    """Returns the folder that the first two parts of a form name."""
    return fill("/".join(form.split("/")[:2]), **parts)


def checked_key(key: str) -> str:
    """Returns the key, if it is one.

    Raises:
        DocumentError: It could leave the store's folder, or collide with what the store hides there.
    """
    parts = key.split("/")
    if len(key.encode()) > 1024 or _CONTROL.search(key) or any(not part or part.startswith(".") for part in parts):
        raise _refused("key", key, KEY_RULE)
    return key


def checked_name(name: str, what: str = "name") -> str:
    """Returns the name, if it may stand in a key; ``what`` names it in the error.

    Raises:
        DocumentError: It may not.
    """
    return _match(_NAME, name, what, NAME_RULE)


def checked_bucket(bucket: str) -> str:
    """Returns the bucket's name, if it is one by S3's rules.

    Raises:
        DocumentError: It is not.
    """
    return _match(_BUCKET, bucket, "s3Bucket", "3 to 63 of a-z 0-9 . -, ends in letters or digits, no two dots")


def _match(pattern: re.Pattern[str], text: str, what: str, rule: str) -> str:
    if not pattern.fullmatch(text):
        raise _refused(what, text, rule)
    return text


def _refused(what: str, text: str, rule: str) -> DocumentError:
    return DocumentError([Fault(path=what, value=repr(text[:80]), allowed=rule)], source="store")
