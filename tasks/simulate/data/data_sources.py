"""The data sources in a batch's plan: files from buckets that jobs read (docs/reference/robomaker.md, section 10)."""

from typing import Literal

from pydantic import Field

from specs.base import Spec, digest
from specs.robomaker.simulation import DataSourceConfig

VARIABLE_PREFIX = "DATA_SOURCE_"
DATA_PREFIX = "data:"
MOST_FILES = 100
MOST_BYTES = 25 << 30
# Where RoboMaker mounted them, here below a folder of the machine's own.
_MOUNT = "opt/robomaker/datasources"
DataFailure = Literal["", "InvalidS3Resource", "BadPermissionsS3Object", "LimitExceeded", "InvalidInput"]


class PinnedFile(Spec):
    """One file of a data source, and the very content that is meant.

    Attributes:
        key: Its key in the bucket.
        sha256: Of its content.
        etag: What the bucket called that content; for answers, and no part of a plan or of what is written of one.
    """

    key: str
    sha256: str
    size_bytes: int
    etag: str = Field(default="", exclude=True)


class PinnedSource(Spec):
    """A data source with the content that it had when the batch was planned.

    Attributes:
        type: Whether the files stand as they are, or are archives that are unpacked.
        destination: Folder that they are put into, relative to where a job's files begin.
        failure_code: Why jobs that need it fail, as RoboMaker's code; empty if they do not.
        failure_reason: The same for a person.
    """

    name: str
    bucket: str
    type: Literal["Prefix", "Archive", "File"]
    destination: str
    files: tuple[PinnedFile, ...] = ()
    failure_code: DataFailure = ""
    failure_reason: str = ""

    @property
    def digest(self) -> str:
        """Returns the SHA-256 of all that it says."""
        return digest(self)

    def failed(self, code: DataFailure, why: str) -> "PinnedSource":
        """Returns it as one that jobs cannot use."""
        reason = f"data source {self.name}: {why}"
        return self.model_copy(update={"files": (), "failure_code": code, "failure_reason": reason})


def unpinned(source: DataSourceConfig) -> PinnedSource:
    """Returns a data source before anybody looked for its files."""
    return PinnedSource(
        name=source.name,
        bucket=source.s3Bucket,
        type=source.type or "File",
        destination=(source.destination or f"{_MOUNT}/{source.name}").strip("/"),
    )


def data_variable(name: str) -> str:
    """Returns the environment variable that tells an application where a data source's files are."""
    return VARIABLE_PREFIX + name.upper().replace("-", "_")


def within_limits(sources: tuple[PinnedSource, ...]) -> tuple[PinnedSource, ...]:
    """Returns a job's data sources, all of them failed if together they are more than a job may have."""
    files = sum(len(source.files) for source in sources)
    size = sum(file.size_bytes for source in sources for file in source.files)
    if files <= MOST_FILES and size <= MOST_BYTES:
        return sources
    why = f"the job's data sources are {files} files of {size:,} bytes; at most {MOST_FILES} and {MOST_BYTES:,} bytes"
    return tuple(source.failed("LimitExceeded", why) for source in sources)
