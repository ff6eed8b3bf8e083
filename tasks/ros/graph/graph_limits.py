"""What a node may ask of a graph; beyond that its connection is closed, or its lane fails with a reason.

All lanes of a chunk share one process, so no application may take what its neighbours need.
"""

CONNECTIONS = 256
"""Connections of an episode at a time. A node holds about five."""

HEADER_BYTES = 64 * 1024
"""A connection's header, or the header of a request."""

BODY_BYTES = 8 * 1024 * 1024
"""A call's XML. A robot's description with its meshes' names takes a few hundred kilobytes."""

BACKLOG_BYTES = 1024 * 1024
"""What a subscriber may leave unread before the next message, besides what the kernel holds."""

COMMAND_MESSAGE_BYTES = 4096
"""One command. A Twist has 48 bytes."""

COMMAND_BYTES = 1024 * 1024
"""Commands of one publisher between two looks: 20,000 Twists."""

PUBLISHERS = 64
"""Nodes that command the robot."""

NODES = 256
"""Nodes of an episode. Robots with arms and cameras have some fifty."""

CALLS = 1000
"""Calls within a ``system.multicall``, and calls that wait for one node."""

REGISTRATIONS = 5000
"""Topics, services and parameters that nodes are registered for."""

NAME_CHARACTERS = 1024

PARAMETER_BYTES = 16 * 1024 * 1024
"""All parameters of an episode, each value counted with its overhead; also what a call is answered with."""

BUFFERED_BYTES = 128 * 1024 * 1024
"""All that an episode's connections hold in this process: half requests, answers that nobody reads, calls that wait."""

PARAMETER_DEPTH = 64
"""Mappings and lists within each other, and namespaces of a name."""

REQUEST_S = 10.0
"""From the first byte of a header or request to its last: wall time."""

CALL_S = 10.0
"""A node's time to answer a call, or a header: wall time. On a busy machine nodes begin slowly."""

HOLD_S = 2.0 * CALL_S
"""How long the answer to a publisher waits until the robot is connected to it: wall time."""

LINK_S = 0.1
"""What a publisher gets after its header, to enter the connection in its list: wall time, once a publisher.

Nothing a node answers tells when it has done so: rospy answers `getBusInfo` only after its registration has returned.
"""
