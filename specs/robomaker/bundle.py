"""Published applications: what the store keeps of them, read by all that simulate or deploy one."""

from typing import Annotated, Literal

from pydantic import Field

from specs.base import Spec
from specs.field_types import Architecture, S3Object
from specs.robomaker.applications import (
    Environment,
    RenderingEngine,
    RobotSoftwareSuite,
    SimulationSoftwareSuite,
    SourceConfig,
)

ApplicationKind = Literal["robot-application", "simulation-application"]
ARCHITECTURES: tuple[Architecture, ...] = ("X86_64", "ARM64", "ARMHF")
LATEST = "$LATEST"
VERSIONS_AT_MOST = 40  # docs/reference/robomaker.md, section 9
Digest = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
Bytes = Annotated[int, Field(ge=0)]


class Build(Spec):
    """A version's bundle for one architecture.

    Attributes:
        architecture: Of the robots that it is for.
        digest: SHA-256 of the bundle's archive, 64 hexadecimal digits.
        size_bytes: Of the archive.
        origin: The object that it was taken from, with the ETag it had; None for one that was packed from a folder.
    """

    architecture: Architecture
    digest: Digest
    size_bytes: Bytes
    origin: S3Object | None = None


class Platform(Spec):
    """What an application says that it is written for: kept, and answered as it was asked.

    Nothing is chosen by it: Simyard runs bundles, on its own engines.

    Attributes:
        image_digest: Of the container image of a version, where the environment has one.
    """

    robot_software_suite: RobotSoftwareSuite | None = None
    simulation_software_suite: SimulationSoftwareSuite | None = None
    rendering_engine: RenderingEngine | None = None
    environment: Environment | None = None
    image_digest: str = ""


class Version(Spec):
    """One version of an application: a number that is never given twice, and the bytes it stands for.

    Attributes:
        kind: Whether it runs robots or tests.
        name: The application.
        number: From 1; those of versions that were deleted are missing.
        digest: SHA-256 of the bundle's archive, 64 hexadecimal digits; of several builds the one for X86_64, which is
            simulated, or else the first.
        size_bytes: Of the archive.
        created_at_s: Seconds since 1970.
        shipped: Whether it came with Simyard and was published by being referred to.
        brought: Whether a run of a document published it, and no command did; such a version may make room for another.
        builds: One for each architecture; none for a bundle that is the same on all of them.
        revision: The application's when the version was made.
        platform: The application's, too.
    """

    kind: ApplicationKind
    name: str
    number: Annotated[int, Field(ge=1)]
    digest: Digest
    size_bytes: Bytes
    created_at_s: float
    shipped: bool = False
    brought: bool = False
    builds: tuple[Build, ...] = ()
    revision: str = ""
    platform: Platform = Platform()

    @property
    def digests(self) -> dict[Architecture, str]:
        """The digest of the bundle for each architecture; empty where one bundle is for all of them."""
        return {build.architecture: build.digest for build in self.builds}


class Application(Spec):
    """All versions of an application, oldest first; one object, so that a new version is one compare-and-swap.

    Attributes:
        last_number: The highest that was ever given, also to a version that was deleted.
        revision: Changes with every change of what ``$LATEST`` stands for.
        sources: Where bundles lie that somebody else puts there, for ``$LATEST``.
        deleted: Whether there is none any more; what is left keeps numbers from being given twice.
        platform: What ``$LATEST`` is written for.
        updated_at_s: When what ``$LATEST`` stands for was last changed by a call; 0 for never.
    """

    kind: ApplicationKind
    name: str
    versions: Annotated[tuple[Version, ...], Field(max_length=VERSIONS_AT_MOST)]
    last_number: int = 0
    revision: str = ""
    sources: tuple[SourceConfig, ...] = ()
    deleted: bool = False
    platform: Platform = Platform()
    tags: dict[str, str] = Field(default_factory=dict[str, str])
    updated_at_s: float = 0.0

    @property
    def numbers(self) -> str:
        """The numbers of its versions, for a person."""
        return ", ".join(str(version.number) for version in self.versions) or "none yet"
