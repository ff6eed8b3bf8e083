"""What a launch file asks of Gazebo: the world, the robot that is spawned, and what stands for each of its nodes.

Gazebo itself is never started: Simyard imports the world, makes the robot of its description, and answers for the rest.
What ``gazebo_ros`` calls its nodes and arguments is what its public documentation says.
"""

import itertools
import math
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from specs.base import Spec
from specs.data.world import Start
from tasks.ros.launch.launch_plan import LaunchPlan, NodePlan
from tasks.ros.launch.packages import STAND_INS, bundle_packages, read_manifest


class Replaced(Spec):
    """A node of a launch file that is not started, and what stands for it.

    Attributes:
        node: Its name, package and program.
        by: What there is instead.
    """

    node: str
    by: str


class GazeboLaunch(Spec):
    """What a launch file asks of Gazebo.

    Attributes:
        world: The world's file; None where Gazebo starts without one, or it is not there (then a finding says so).
        model_folders: Where ``model://`` and its like are looked for.
        entity: What the spawned robot is called; empty without one.
        spawn: Where it is spawned; None without one.
        description: The robot's URDF or SDF, as it is spawned; None without one.
        nodes: What runs beside the robot application's nodes.
        replaced: What does not run, and what stands for it.
        findings: What is asked for and cannot be had, a sentence each.
    """

    world: Path | None = None
    model_folders: tuple[Path, ...] = ()
    entity: str = ""
    spawn: Start | None = None
    description: str | None = None
    nodes: tuple[NodePlan, ...] = ()
    replaced: tuple[Replaced, ...] = ()
    findings: tuple[str, ...] = ()


# What nodes are called, in ROS 1's Gazebo, ROS 2's, and gz; of ROS 2's bridges and clients there are several.
_SERVERS = frozenset({"gazebo", "gzserver", "debug", "gdbrun", "perf", "gz_sim", "gz_server"})
_CLIENTS = frozenset({"gzclient", "gzclient_gdb"})
_SPAWNERS = frozenset({"spawn_model", "spawn_urdf", "spawn_gazebo_model", "spawn_entity.py", "create"})
_GAZEBO_ROS = frozenset({"gazebo_ros", "gazebo", "ros_gz_sim", "ros_ign_gazebo"})
# Programs that a launch file may start by itself, and their words: ``gz sim -r hall.sdf``.
_BARE = frozenset({"gazebo", "gzserver", "gzclient"})
_GZ_PROGRAMS = {"gz": "sim", "ign": "gazebo"}
_STAND_FOR = {
    "rviz": "nothing: it shows pictures to a person",
    "rviz2": "nothing: it shows pictures to a person",
    "rqt_gui": "nothing: it shows windows to a person",
    "joint_state_publisher": "the robot's own joint states",
    "joint_state_publisher_gui": "the robot's own joint states",
    "ros_gz_bridge": "the robot's own topics, which need no bridge",
    "ros_ign_bridge": "the robot's own topics, which need no bridge",
    "ros_gz_image": "nothing: there are no cameras",
    "ros_ign_image": "nothing: there are no cameras",
}
_STATE_PUBLISHER = "robot_state_publisher"
# Of Gazebo's server: what takes a value.
_SERVER_VALUES = (
    "-e --physics -g --gui-plugin -s --server-plugin -p --play -P -o --profile --seed --iters "
    "--record_path --record_encoding --record_filter --record_period --initial_sim_time"
)
# Of gz: there ``-g`` and ``-s`` take none.
_GZ_VALUES = (
    "-v --verbose -z --seed --iterations --record-path --record-topic --playback --gui-config --physics-engine "
    "--render-engine --render-engine-gui --render-engine-server --network-role --network-secondaries --initial-sim-time"
)
# Of spawn_model, spawn_entity.py and create: what takes a value.
_SPAWN_VALUES = (
    "-model -entity -name -file -param -topic -string -database -world -x -y -z -R -P -Y -robot_namespace "
    "-reference_frame -gazebo_namespace -package_to_model -J -timeout -spawn_service_timeout -wait -allow_renaming"
)
# Where gz looks for models and for worlds alike.
_GZ_PATHS = ("GZ_SIM_RESOURCE_PATH", "IGN_GAZEBO_RESOURCE_PATH", "SDF_PATH")
_MOST_DESCRIPTION_BYTES = 8 << 20


def read_gazebo_launch(plan: LaunchPlan, bundle: Path, variables: Mapping[str, str]) -> GazeboLaunch | None:
    """Returns what a launch file asks of Gazebo; None if it starts nothing that Simyard stands for.

    Args:
        plan: The launch file as ROS resolved it.
        bundle: Folder that holds the ROS packages.
        variables: The episode's environment variables.
    """
    servers = [node for node in plan.nodes if _role(node) == "server"]
    spawners = [node for node in plan.nodes if _role(node) == "spawner"]
    replaced = dict(_replaced(plan.nodes))
    if not replaced:
        return None
    reading = _Reading(plan, bundle, variables, servers)
    world = reading.world(servers[0]) if servers else None
    robot = reading.robot(spawners)
    return GazeboLaunch(
        world=world,
        model_folders=reading.model_folders,
        entity=robot.entity,
        spawn=robot.spawn,
        description=robot.description,
        nodes=started_nodes(plan),
        replaced=tuple(replaced.values()),
        findings=tuple(reading.findings),
    )


def spawned_model(plan: LaunchPlan, bundles: Iterable[Path], variables: Mapping[str, str]) -> str:
    """Returns what the robot is called that a launch file spawns; ``robot`` for one that nobody spawns.

    Args:
        plan: The nodes of an episode's applications.
        bundles: Folders that hold their packages.
        variables: The episode's environment variables.
    """
    found = (read_gazebo_launch(plan, bundle, variables) for bundle in bundles)
    return next((each.entity for each in found if each and each.entity), "robot")


def started_nodes(plan: LaunchPlan) -> tuple[NodePlan, ...]:
    """Returns the nodes of a launch file that are started: all that nothing stands for."""
    replaced = dict(_replaced(plan.nodes))
    return tuple(node for node in plan.nodes if node.name not in replaced)


def shown_node(node: NodePlan) -> str:
    """Returns a node for a person: ``/roam (roamer roam.py)``."""
    return f"{node.name} ({node.package} {node.kind})"


_ROLES = {
    "server": "Simyard's engine, in the world that is imported",
    "client": "nothing: it shows the world to a person",
    "spawner": "the robot of robot.xml, or the draft of its description, at the spawn's place",
}


def _replaced(nodes: Sequence[NodePlan]) -> Iterator[tuple[str, Replaced]]:
    """Yields the nodes that do not run, by name."""
    for node in nodes:
        by = _ROLES.get(_role(node)) or _STAND_FOR.get(node.package, "")
        if node.package == _STATE_PUBLISHER and STAND_INS in Path(node.command[0]).parts:
            by = "the frames of the robot's base and sensors; no others, as ROS 2's robot_state_publisher is not here"
        if by:
            yield node.name, Replaced(node=shown_node(node), by=by)


def _role(node: NodePlan) -> str:
    """Returns what a node is to Gazebo: ``server``, ``client``, ``spawner``, or nothing."""
    words = _words(node)
    program = Path(words[0]).name if words else ""
    if _is_gz(node):
        return "client" if "-g" in words else "server"
    if node.package not in _GAZEBO_ROS and (node.package or program not in _BARE):
        return ""
    kind = node.kind if node.package else program
    roles = {"server": _SERVERS, "client": _CLIENTS, "spawner": _SPAWNERS}
    return next((role for role, kinds in roles.items() if kind in kinds), "")


def _is_gz(node: NodePlan) -> bool:
    words = _words(node)
    bare = not node.package and len(words) > 1 and words[1] == _GZ_PROGRAMS.get(Path(words[0]).name)
    return bare or (node.package in _GAZEBO_ROS and node.kind in {"gz_sim", "gz_server"})


def _words(node: NodePlan) -> list[str]:
    """Returns the words of a node's command, of which one may hold several, without those that are ROS 2's own."""
    command = node.command[2:] if node.command[:2] == ("/bin/sh", "-c") else node.command
    words = [part for word in command for part in (_split(word) if " " in word and "<" not in word else [word])]
    return words[: words.index(_ROS_ARGUMENTS)] if _ROS_ARGUMENTS in words else words


_ROS_ARGUMENTS = "--ros-args"


def _split(text: str) -> list[str]:
    try:
        return shlex.split(text)
    except ValueError:  # a quotation that does not end
        return text.split()


class _Robot(Spec):
    entity: str = ""
    spawn: Start | None = None
    description: str | None = None


class _Reading:
    """The reading of one launch file."""

    def __init__(
        self, plan: LaunchPlan, bundle: Path, variables: Mapping[str, str], servers: Sequence[NodePlan]
    ) -> None:
        self.findings: list[str] = []
        self._plan, self._bundle = plan, bundle
        self._packages = bundle_packages(bundle)
        own = dict(pair for node in servers for pair in node.environment)
        self._variables = {**variables, **own}
        exported, media = self._exports()
        self.model_folders = self._folders("GAZEBO_MODEL_PATH", exported, "models")
        self._media = self._folders("GAZEBO_RESOURCE_PATH", media, "worlds", "")

    def world(self, server: NodePlan) -> Path | None:
        """Returns the file of the world that a server is started with."""
        given = _positional(_words(server)[1:], (_GZ_VALUES if _is_gz(server) else _SERVER_VALUES).split())
        given = [word for word in given if word and word not in _GZ_PROGRAMS.values()]
        if not given:
            return None
        name = Path(given[-1])
        places = [name] if name.is_absolute() else [folder / name for folder in self._media]
        places += [] if name.is_absolute() else [folder / name.name for folder in self._media]
        found = next((place for place in places if place.is_file()), None)
        if found is None:
            where = "" if name.is_absolute() else f", looked for in {', '.join(map(str, self._media))}"
            self.findings.append(f"the world {name} is not there{where}: put it into the bundle")
        elif not found.resolve().is_relative_to(self._bundle.resolve()):
            self.findings.append(f"the world {name} lies outside the bundle: put it into the bundle")
            return None
        return found

    def robot(self, spawners: Sequence[NodePlan]) -> _Robot:
        """Returns the robot among what is spawned: what a parameter describes, else the first."""
        asked = [(node, _options(_words(node)[1:])) for node in spawners]
        asked.sort(key=lambda each: not {"-param", "-topic"} & each[1].keys())
        for node, options in asked[1:]:
            model = _entity(options) or "a model"
            self.findings.append(f"{node.name} spawns {model}, which is not taken: put it into the world's file")
        if not asked:
            return _Robot()
        node, options = asked[0]
        return _Robot(
            entity=_entity(options),
            spawn=self._spawn(node, options),
            description=self._description(node, options),
        )

    def _spawn(self, node: NodePlan, options: Mapping[str, str]) -> Start:
        numbers = {name: self._number(node, name, options.get(name, "0")) for name in ("-x", "-y", "-Y", "-R", "-P")}
        if numbers["-R"] or numbers["-P"]:
            self.findings.append(f"{node.name} spawns the robot leaning (-R, -P): it starts upright")
        return Start(x_m=numbers["-x"], y_m=numbers["-y"], yaw_rad=numbers["-Y"])

    def _number(self, node: NodePlan, name: str, text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if math.isfinite(number):
            return number
        self.findings.append(f"{node.name}: {name} {text[:80]!r} is no number: 0 is taken")
        return 0.0

    def _description(self, node: NodePlan, options: Mapping[str, str]) -> str | None:
        if "-string" in options:
            return options["-string"]
        for option, what in (("-param", "parameter"), ("-topic", "topic")):
            if name := options.get(option):
                full = name if name.startswith("/") else f"{node.namespace.rstrip('/')}/{name}"
                text = self._plan.parameters.get(full, self._plan.parameters.get(f"/{name.rpartition('/')[2]}"))
                if isinstance(text, str):
                    return text
                self.findings.append(f"{node.name} spawns what the {what} {full} describes, and nobody sets it")
                return None
        if "-file" in options:
            return self._text(node, Path(options["-file"]))
        if "-database" in options:
            return self._text(node, *(each / options["-database"] / "model.sdf" for each in self.model_folders))
        return None

    def _text(self, node: NodePlan, *places: Path) -> str | None:
        found = next((each for each in places if each.is_file()), None)
        if found is None:
            where = ", ".join(map(str, places)) or "no folder of models"
            self.findings.append(f"{node.name} spawns a file that is not there: {where}")
            return None
        if found.stat().st_size > _MOST_DESCRIPTION_BYTES:
            self.findings.append(f"{node.name} spawns {found}, which has more than {_MOST_DESCRIPTION_BYTES:,} bytes")
            return None
        return found.read_text(errors="replace")

    def _exports(self) -> tuple[list[Path], list[Path]]:
        """Returns what packages export to Gazebo: folders of models, and of other files."""
        models, media = list[Path](), list[Path]()
        for folder in self._packages.values():
            for element in read_manifest(folder / "package.xml").findall("export/gazebo_ros"):
                for name, into in (("gazebo_model_path", models), ("gazebo_media_path", media)):
                    paths = element.get(name, "").replace("${prefix}", str(folder)).split(":")
                    into += [Path(each) for each in paths if each]
        return models, media

    def _folders(self, variable: str, exported: Sequence[Path], *inside: str) -> tuple[Path, ...]:
        """Returns the folders of the bundle that an environment variable, exports and packages name."""
        names = (variable, *_GZ_PATHS)
        named = [Path(each) for name in names for each in self._variables.get(name, "").split(":") if each]
        own = [folder / name for name in inside for folder in self._packages.values()]
        found = dict.fromkeys(each.resolve() for each in (*named, *exported, *own) if each.is_dir())
        return tuple(each for each in found if each.is_relative_to(self._bundle.resolve()))


def _positional(words: Sequence[str], with_value: Sequence[str]) -> list[str]:
    """Returns the words of a command that belong to no option; ROS's own remappings are none either."""
    found, skip = list[str](), False
    for word in words:
        if not skip and not word.startswith("-") and ":=" not in word:
            found.append(word)
        skip = not skip and word in with_value
    return found


def _options(words: Sequence[str]) -> dict[str, str]:
    """Returns the options of a spawner with their values; those that have none, or an empty one, are not there."""
    found = {each: value for each, value in itertools.pairwise(words) if each in _SPAWN_VALUES.split()}
    return {name: value for name, value in found.items() if value}


def _entity(options: Mapping[str, str]) -> str:
    return next((options[name] for name in ("-model", "-entity", "-name") if name in options), "")
