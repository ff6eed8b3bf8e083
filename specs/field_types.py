"""Types that occur all over RoboMaker's documents: names, ARNs, tags, places in buckets, times.

An alias carries the name of the shape in RoboMaker's interface; its bounds, pattern (a full match) and members are that
shape's. Numbers and text are never converted into each other: ``applicationVersion: 1`` is a number, ``"1"`` is text.
"""

from collections.abc import Mapping
from typing import Annotated, Literal

from pydantic import AfterValidator, Field, Strict, StringConstraints

from specs.base import Spec
from specs.rules import broken
from specs.untrusted_text import terminal_text

EngineName = Literal["planar", "mjx", "mujoco"]


BagFormat = Literal["rosbag", "mcap-ros1", "rosbag2"]
"""A bag of ROS 1; MCAP with ROS 1's messages; a folder of rosbag2, with ROS 2's messages in MCAP."""

BAG_ENDINGS: Mapping[BagFormat, str] = {"rosbag": ".bag", "mcap-ros1": "-ros1.mcap", "rosbag2": "-rosbag2"}
"""What the name of a format's file ends in, or the name of its folder."""


def text(low: int, high: int, pattern: str) -> StringConstraints:
    """Returns the constraint for text of so many characters that matches a pattern from end to end."""
    return StringConstraints(strict=True, min_length=low, max_length=high, pattern=f"^(?:{pattern})$")


def _not_reserved(key: str) -> str:
    if key.lower().startswith("aws:"):
        raise broken('a key that does not begin with "aws:", which is reserved')
    return key


def _not_provided(name: str) -> str:
    if name.startswith("AWS"):
        raise broken('a name that does not begin with "AWS", which is reserved')
    return name


def _environment_ready(tags: dict[str, str]) -> dict[str, str]:
    for key in tags:
        if not (key.isascii() and key.replace("_", "").isalnum()):
            raise broken(f"keys of letters, digits and underscores, as robots see them as variables; not {key!r}")
    return tags


def _inside_bucket(prefix: str) -> str:
    parts = prefix.strip("/").split("/")
    unseen = any(mark in prefix for mark in "\\\t\n") or terminal_text(prefix) != prefix
    if unseen or any(part.startswith(".") or (not part and len(parts) > 1) for part in parts):
        raise broken("a folder inside the bucket: parts joined by /, none empty, beginning with a dot or with \\ in it")
    return prefix


Text = Annotated[str, Strict()]
Integer = Annotated[int, Strict()]
Boolean = Annotated[bool, Strict()]
BoxedBoolean = Boolean
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Timestamp = Annotated[float, Strict(), Field(allow_inf_nan=False, description="Seconds since 1970-01-01 UTC.")]
CreatedAt = LastUpdatedAt = LastStartedAt = FailedAt = Timestamp

GENERIC_PATTERN = ".*"
ARN_PATTERN = "arn:.*"
NAME_PATTERN = r"[a-zA-Z0-9_\-]*"
COMMAND_PATTERN = r"[a-zA-Z0-9_.\-]*"
TAG_PATTERN = r"[a-zA-Z0-9 _.\-\/+=:]*"
TOKEN_PATTERN = r"[a-zA-Z0-9_\-=]*"  # noqa: S105 - a pattern, no secret
BUCKET_PATTERN = r"[a-z0-9][a-z0-9.\-]*[a-z0-9]"
ROLE_PATTERN = r"arn:aws:iam::\w+:role/.*"
VERSION_PATTERN = r"(\$LATEST)|[0-9]*"
NUMBER_PATTERN = "[0-9]*"
VARIABLE_PATTERN = "[A-Z_][A-Z0-9_]*"
PAGINATION_PATTERN = r"[a-zA-Z0-9_.\-\/+=]*"
PLAIN_NAME_PATTERN = r"[a-zA-Z0-9][a-zA-Z0-9_\-]{0,63}"
REFERENCE_PATTERN = rf"{ARN_PATTERN}|{PLAIN_NAME_PATTERN}"
WORLD_REFERENCE_PATTERN = rf"{ARN_PATTERN}|({PLAIN_NAME_PATTERN}/)?{PLAIN_NAME_PATTERN}"

Arn = Annotated[str, text(1, 1224, ARN_PATTERN)]
Name = Annotated[str, text(1, 255, NAME_PATTERN)]
Id = Annotated[str, text(1, 1224, GENERIC_PATTERN)]
GenericString = Annotated[str, text(0, 1024, GENERIC_PATTERN)]
NonEmptyString = Annotated[str, text(1, 255, ".+")]
Command = Annotated[str, text(1, 1024, COMMAND_PATTERN)]
Path = Annotated[str, text(1, 1024, GENERIC_PATTERN)]
Version = Annotated[str, text(1, 255, VERSION_PATTERN)]
ClientRequestToken = Annotated[str, text(1, 64, TOKEN_PATTERN)]
IamRole = Annotated[str, text(1, 255, ROLE_PATTERN)]
PaginationToken = Annotated[str, text(1, 2048, PAGINATION_PATTERN)]
S3Bucket = Annotated[str, text(3, 63, BUCKET_PATTERN)]
S3Key = Annotated[str, text(1, 1024, GENERIC_PATTERN)]
S3KeyOrPrefix = Annotated[str, text(0, 1024, GENERIC_PATTERN)]
S3Etag = Text

TagKey = Annotated[str, text(1, 128, TAG_PATTERN), AfterValidator(_not_reserved)]
TagValue = Annotated[str, text(0, 256, TAG_PATTERN)]
TagMap = Annotated[dict[TagKey, TagValue], Field(max_length=50)]
RobotTagMap = Annotated[TagMap, AfterValidator(_environment_ready)]
"""Tags of robots and deployments become AWS_ROBOMAKER_ROBOT_TAG_KEY_<KEY> on the robot.

See docs/reference/robomaker.md, section 9.
"""

EnvironmentVariableKey = Annotated[str, text(1, 1024, VARIABLE_PATTERN), AfterValidator(_not_provided)]
EnvironmentVariableValue = Annotated[str, text(1, 1024, GENERIC_PATTERN)]
EnvironmentVariableMap = Annotated[dict[EnvironmentVariableKey, EnvironmentVariableValue], Field(max_length=20)]

Arns = Annotated[tuple[Arn, ...], Field(min_length=1, max_length=100)]
AllArns = Annotated[tuple[Arn, ...], Field(min_length=1)]
"""The ARNs of an answer, which is not cut off at 100 (docs/reference/robomaker.md, section 5)."""
Architecture = Literal["X86_64", "ARM64", "ARMHF"]

PlainName = Annotated[str, text(1, 64, PLAIN_NAME_PATTERN)]
Reference = Annotated[str, text(1, 1224, REFERENCE_PATTERN)]
"""A resource in a pipeline: its plain name, an ARN of this store, or one of RoboMaker's."""
WorldReference = Annotated[str, text(1, 1224, WORLD_REFERENCE_PATTERN)]
"""A world in a pipeline: ``<generation>/<world>``, an ARN, or the name of one that the document imports."""


class OutputLocation(Spec):
    """Where results are put: a bucket (SIMYARD_BUCKETS says what it stands for) and a prefix in it."""

    s3Bucket: S3Bucket | None = Field(default=None, title="Bucket", description="Name of the bucket.")
    s3Prefix: Annotated[S3Key, AfterValidator(_inside_bucket)] | None = Field(
        default=None, title="Prefix", description="Folder in the bucket."
    )


class S3Object(Spec):
    """One object in a bucket, and optionally the very content that is meant.

    Attributes:
        bucket: Name of the bucket.
        key: Of the object, in that bucket.
    """

    bucket: S3Bucket = Field(title="Bucket")
    key: S3Key = Field(title="Key")
    etag: S3Etag | None = Field(default=None, title="ETag", description="Pins the content; another one is refused.")


class Filter(Spec):
    """A condition on what is listed: the field has one of the values."""

    name: Name | None = None
    values: Annotated[tuple[Name, ...], Field(min_length=1, max_length=1)] | None = None


Filters = Annotated[tuple[Filter, ...], Field(min_length=1, max_length=3)]
"""Several filters are alternatives; up to three, as the older interface had it.

See docs/reference/robomaker.md, section 9.
"""


class Page(Spec):
    """What every list request may say: which page, and how long."""

    nextToken: PaginationToken | None = None
    maxResults: Integer | None = None


class FilteredPage(Page):
    """A list request that may also filter."""

    filters: Filters | None = None
