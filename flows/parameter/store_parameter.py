"""How a person names a store: a URL, or a block of Prefect's; never a password.

A parameter of a flow is kept in Prefect's database, shown in its pages and written to logs. So what would carry a
secret is refused before Prefect has it: by the JSON schema that the server checks, and by the same rule in Python.
Neither message repeats the value.
"""

import re
from typing import Annotated

from pydantic import BeforeValidator, WithJsonSchema

from specs.rules import broken

ALLOWED = (
    "file:///folder, s3://bucket/prefix, block://s3-bucket/NAME or block://aws-credentials/NAME/bucket/prefix, without "
    "a password, key or token in it: credentials come from the environment, or from the block"
)
# A password before the host, also one with a slash in it, as AWS makes them, or something like key=... after a question
# mark. Without (?i), which JavaScript lacks.
_CARRIES = (
    r"//[^/]*@|^[^/]*//[^/]*:|[?&#;][^=]*([Kk][Ee][Yy]|[Ss][Ee][Cc][Rr][Ee][Tt]|[Tt][Oo][Kk][Ee][Nn]|[Pp][Aa][Ss][Ss]"
    r"|[Ss][Ii][Gg]|[Cc][Rr][Ee][Dd])[^=]*="
)


def has_secret(url: str) -> bool:
    """Returns whether a URL carries a password, a key or a token."""
    return re.search(_CARRIES, url) is not None


def without_secret(value: object) -> object:
    """Returns a store's name as it is.

    Raises:
        PydanticCustomError: It carries a secret; the message does not.
    """
    if isinstance(value, str) and has_secret(value):
        raise broken(ALLOWED)
    return value


StoreParameter = Annotated[
    str | None,
    BeforeValidator(without_secret),
    # With "not", the server's message would repeat the value; that of "const" says only what is allowed.
    WithJsonSchema(
        {
            "anyOf": [{"type": "string"}, {"type": "null"}],
            "if": {"type": "string", "pattern": _CARRIES},
            "then": {"const": ALLOWED},
        }
    ),
]
"""A store, as a parameter of a flow; None is SIMYARD_STORE, else ``.simyard`` in the working directory."""
