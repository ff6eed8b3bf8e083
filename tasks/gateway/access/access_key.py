"""An access key, and the form of the file that keeps several: that of ~/.aws/credentials, a profile for each key."""

import configparser
import io
import secrets
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal, get_args

from specs.base import Fault
from specs.errors import DocumentError
from tasks.gateway.access.scope import Scope, parse_scope
from tasks.storage.base.key_rules import checked_name

KeyRight = Literal["read", "simulate", "deploy"]
RIGHTS: tuple[KeyRight, ...] = get_args(KeyRight)
_ID, _SECRET, _RIGHTS, _ON = "aws_access_key_id", "aws_secret_access_key", "simyard_rights", "simyard_on"
_FIELDS = frozenset({_ID, _SECRET, _RIGHTS, _ON})
_NO_SECTION = "\0"


@dataclass(frozen=True)
class AccessKey:
    """Who may call, and what.

    Attributes:
        name: The profile; it stands in the log of actions.
        key_id: What a request names.
        secret: What a request is signed with.
        rights: What it may do; none of them is part of another.
        scopes: What it is limited to; empty for everything in the store.
    """

    name: str
    key_id: str
    secret: str = field(repr=False)
    rights: frozenset[KeyRight]
    scopes: tuple[Scope, ...] = ()


def new_key(name: str, rights: Iterable[str], on: Iterable[str] = ()) -> AccessKey:
    """Returns a key that nobody had before.

    Args:
        name: The profile's.
        rights: Some of ``RIGHTS``.
        on: What it is limited to, as ``parse_scope`` reads it.

    Raises:
        DocumentError: The name, a right or a limit is none.
    """
    key_id = f"SIMYARD{secrets.token_hex(7)[:13].upper()}"
    scopes = tuple(parse_scope(text) for text in on)
    return AccessKey(_checked_profile(name), key_id, secrets.token_urlsafe(30), _checked_rights(rights), scopes)


def read_profiles(text: str, source: str) -> Mapping[str, AccessKey]:
    """Returns the keys of a file by their ids.

    Args:
        text: What is in the file.
        source: Its name, for the message.

    Raises:
        DocumentError: It is not such a file; the message holds no secret.
    """
    parser = _parser()
    try:
        parser.read_string(text)
    except configparser.Error:  # its own message, and the exception as a cause, may show the line with the secret
        raise _fault(source, "the file", "profiles in the form of ~/.aws/credentials, each name once") from None
    keys = [_key(name, dict(parser[name]), source) for name in parser.sections()]
    found = {key.key_id: key for key in keys}
    if len(found) < len(keys):
        raise _fault(source, _ID, "another one in each profile")
    return found


def profiles_text(keys: Iterable[AccessKey]) -> str:
    """Returns the file that keeps the keys."""
    parser = _parser()
    for key in keys:
        parser[key.name] = {_ID: key.key_id, _SECRET: key.secret, _RIGHTS: " ".join(sorted(key.rights))}
        if key.scopes:
            parser[key.name][_ON] = " ".join(scope.text for scope in key.scopes)
    out = io.StringIO()
    parser.write(out)
    return out.getvalue()


def _key(name: str, fields: Mapping[str, str], source: str) -> AccessKey:
    if missing := sorted({_ID, _SECRET, _RIGHTS} - {each for each, value in fields.items() if value}):
        raise _fault(source, name, f"a profile with {', '.join(missing)}")
    if unknown := sorted(fields.keys() - _FIELDS):
        raise _fault(source, name, f"a profile without {', '.join(unknown)}")
    if _ON in fields and not fields[_ON].split():  # an emptied limit is not "no limit"
        raise _fault(source, name, f"a profile without {_ON}, or with something in it")
    scopes = tuple(parse_scope(text) for text in fields.get(_ON, "").split())
    return AccessKey(name, fields[_ID], fields[_SECRET], _checked_rights(fields[_RIGHTS].split()), scopes)


def _checked_profile(name: str) -> str:
    if name.upper() == configparser.DEFAULTSECT:  # AWS's clients take [DEFAULT] for what all profiles share
        if name != "default":
            raise _fault("access key", name, "another name, or default")
        return name
    return checked_name(name)


def _checked_rights(rights: Iterable[str]) -> frozenset[KeyRight]:
    asked = set(rights)
    if not asked or not asked <= {*RIGHTS}:
        raise _fault("access key", " ".join(sorted(asked)), f"some of {', '.join(RIGHTS)}")
    return frozenset(right for right in RIGHTS if right in asked)


def _parser() -> configparser.ConfigParser:
    return configparser.ConfigParser(interpolation=None, default_section=_NO_SECTION, delimiters=("=",))


def _fault(source: str, value: str, allowed: str) -> DocumentError:
    return DocumentError([Fault(path="access key", value=repr(value), allowed=allowed)], source=source)
