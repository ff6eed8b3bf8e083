"""What a participant tells of its nodes on ``ros_discovery_info``: with it ``ros2 node list`` and ``info`` know them.

Source: rmw_dds_common, messages Gid, NodeEntitiesInfo and ParticipantEntitiesInfo.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple
from uuid import UUID

import numpy as np

from tasks.ros.ros2.interface_types import DEFAULT_DISTRIBUTION, type_store

TOPIC = "ros_discovery_info"
KIND = "rmw_dds_common/msg/ParticipantEntitiesInfo"
_GID, _NODE = "rmw_dds_common/msg/Gid", "rmw_dds_common/msg/NodeEntitiesInfo"


class NodeEntities(NamedTuple):
    """A node: its name, its namespace, and its readers and writers.

    Attributes:
        readers, writers: DDS's GUIDs, as 16 bytes of a UUID.
    """

    namespace: str
    name: str
    readers: Sequence[UUID]
    writers: Sequence[UUID]


def entities_cdr(participant: UUID, nodes: Sequence[NodeEntities], distribution: str = DEFAULT_DISTRIBUTION) -> bytes:
    """Returns the message of a participant's nodes, as CDR.

    Args:
        participant: The participant's GUID.
        nodes: Its nodes.
        distribution: The release of ROS 2 that is spoken to; a Gid of Humble has 24 bytes, later ones have 16.
    """
    store = type_store(distribution)
    message = store.types[KIND](
        gid=_gid(participant, distribution),
        node_entities_info_seq=[_node(each, distribution) for each in nodes],
    )
    return bytes(store.serialize_cdr(message, KIND))


def _node(node: NodeEntities, distribution: str) -> Any:  # noqa: ANN401 - a class that rosbags makes
    return type_store(distribution).types[_NODE](
        node_namespace=node.namespace,
        node_name=node.name,
        reader_gid_seq=[_gid(each, distribution) for each in node.readers],
        writer_gid_seq=[_gid(each, distribution) for each in node.writers],
    )


def _gid(guid: UUID, distribution: str) -> Any:  # noqa: ANN401 - a class that rosbags makes
    store = type_store(distribution)
    (_, (_, (_, count))) = store.fielddefs[_GID][1][0]
    return store.types[_GID](data=np.frombuffer(guid.bytes.ljust(int(count), b"\0"), np.uint8))
