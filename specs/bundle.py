"""Published applications: what the store keeps of them, read by all that simulate or deploy one."""

from typing import Annotated, Literal

from pydantic import Field

from specs.base import Spec

ApplicationKind = Literal["robot-application", "simulation-application"]
LATEST = "$LATEST"
VERSIONS_AT_MOST = 40  # semantics 9


class Version(Spec):
    """One version of an application: a number that is never given twice, and the bytes it stands for.

    Attributes:
        kind: Whether it runs robots or tests.
        name: The application.
        number: From 1, without gaps.
        digest: SHA-256 of the bundle's archive, 64 hexadecimal digits.
        size_bytes: Of the archive.
        created_at_s: Seconds since 1970.
        shipped: Whether it came with Simyard and was published by being referred to.
    """

    kind: ApplicationKind
    name: str
    number: Annotated[int, Field(ge=1, le=VERSIONS_AT_MOST)]
    digest: Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
    size_bytes: Annotated[int, Field(ge=0)]
    created_at_s: float
    shipped: bool = False


class Application(Spec):
    """All versions of an application, oldest first; one object, so that a new version is one compare-and-swap."""

    kind: ApplicationKind
    name: str
    versions: Annotated[tuple[Version, ...], Field(min_length=1, max_length=VERSIONS_AT_MOST)]
