"""A node that gives its job a tag, cancels it, and ends: the header of rmw_cyclonedds before each request."""

from dataclasses import dataclass

from cyclonedds.idl import IdlStruct, types
from cyclonedds.idl.annotations import final
from player import Node, Twist


@final
@dataclass
class Tag(IdlStruct, typename="robomaker_simulation_msgs.msg.dds_.Tag_"):
    key: str
    value: str


@final
@dataclass
class AddTagsRequest(IdlStruct, typename="robomaker_simulation_msgs.srv.dds_.AddTags_Request_"):
    guid: types.uint64
    sequence: types.int64
    tags: types.sequence[Tag]


@final
@dataclass
class CancelRequest(IdlStruct, typename="robomaker_simulation_msgs.srv.dds_.Cancel_Request_"):
    guid: types.uint64
    sequence: types.int64
    structure_needs_at_least_one_member: types.uint8


node = Node()
publish = node.publisher("/cmd_vel", Twist)
add_tags = node.publisher("/robomaker/job/add_tags", AddTagsRequest, name="rq/robomaker/job/add_tagsRequest")
cancel = node.publisher("/robomaker/job/cancel", CancelRequest, name="rq/robomaker/job/cancelRequest")


def on_timer() -> None:
    add_tags(AddTagsRequest(9, 1, [Tag("room", "kitchen")]))  # type: ignore[arg-type]
    cancel(CancelRequest(9, 2, 0))


node.timer(500_000_000, on_timer)
node.spin()
