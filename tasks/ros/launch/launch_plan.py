"""What a launch file starts: its nodes with their commands, and its parameters."""

from typing import Any, NamedTuple


class NodePlan(NamedTuple):
    """A process that a launch file starts.

    Attributes:
        name: The node's full name, such as ``/robot/driver``.
        package, kind: The node's ``pkg`` and ``type``.
        command: Program and arguments, the launch-prefix before them.
        environment: What ``<env>`` sets.
        namespace: That the node is started in; ``/`` for none.
        cwd: Folder that it is started in; empty for the episode's own.
        required: Its end is the end of the application.
        respawn: roslaunch would start it again.
    """

    name: str
    package: str
    kind: str
    command: tuple[str, ...]
    environment: tuple[tuple[str, str], ...] = ()
    namespace: str = "/"
    cwd: str = ""
    required: bool = False
    respawn: bool = False

    def own_environment(self) -> dict[str, str]:
        """Returns what this node has besides its application's environment."""
        below = {} if self.namespace == "/" else {"ROS_NAMESPACE": self.namespace.rstrip("/")}
        return {**dict(self.environment), **below}


class LaunchPlan(NamedTuple):
    """A launch file as roslaunch resolved it.

    Attributes:
        file: The launch file.
        nodes: In the file's order.
        parameters: Of the parameter server, by full name.
    """

    file: str
    nodes: tuple[NodePlan, ...]
    parameters: dict[str, Any]
