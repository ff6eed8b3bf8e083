"""Tags of whatever has an ARN: RoboMaker's requests and answers."""

from specs.base import Spec
from specs.field_types import Arn, TagKey, TagMap


class ListTagsForResourceRequest(Spec):
    """Asks for the tags of a resource."""

    resourceArn: Arn


class ListTagsForResourceResponse(Spec):
    """The tags of a resource."""

    tags: TagMap | None = None


class TagResourceRequest(Spec):
    """Asks for tags to be added to a resource; one of the same key is overwritten."""

    resourceArn: Arn
    tags: TagMap


class TagResourceResponse(Spec):
    """Says nothing."""


class UntagResourceRequest(Spec):
    """Asks for tags to be removed from a resource."""

    resourceArn: Arn
    tagKeys: tuple[TagKey, ...]


class UntagResourceResponse(Spec):
    """Says nothing."""
