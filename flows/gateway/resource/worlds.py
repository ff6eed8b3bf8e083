"""Calls about worlds."""

from flows.gateway.gateway import Gateway, Handlers
from flows.gateway.references import path_of
from flows.resource.tags_now import with_tags_now
from specs.errors import DocumentError
from specs.robomaker.world_descriptions import DescribeWorldResponse
from specs.robomaker.world_jobs import BatchDeleteWorldsRequest, BatchDeleteWorldsResponse, DescribeWorldRequest
from tasks.worlds.job.describe import describe_stored_world
from tasks.worlds.job.world_deletion import delete_worlds


def _describe(gateway: Gateway, request: DescribeWorldRequest) -> DescribeWorldResponse:
    world = path_of(gateway.store, request.world, "world", "world")
    return with_tags_now(gateway.store, "world", world, describe_stored_world(gateway.store, world))


def _batch_delete(gateway: Gateway, request: BatchDeleteWorldsRequest) -> BatchDeleteWorldsResponse:
    """Deletes what can be deleted; a call does not fail because of single worlds.

    See docs/reference/robomaker.md, section 9.
    """
    paths: dict[str, str] = {}
    left: list[str] = []
    for each in dict.fromkeys(request.worlds):
        try:
            paths[each] = path_of(gateway.store, each, "world", "worlds")
        except DocumentError:
            left.append(each)
    refused = set(delete_worlds(gateway.store, paths.values()))
    left += [each for each, path in paths.items() if path in refused]
    return BatchDeleteWorldsResponse(unprocessedWorlds=tuple(left) or None)


HANDLERS: Handlers = {"BatchDeleteWorlds": _batch_delete, "DescribeWorld": _describe}
