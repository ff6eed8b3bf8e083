"""What a launch file of ROS 1 starts: roslaunch's own code resolves it to a plan of nodes with their environment.

Reading a launch file runs what it says; what that starts and leaves behind is ended with the program. The program is
text here, because ROS's Python is another one than Simyard's, and has the modules that it imports. Whatever roslaunch
refuses comes back as a sentence; whatever Simyard does not do for a launch file is a sentence as well.
"""

import base64
import contextlib
import json
import os
import re
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any, NamedTuple, Self
from xmlrpc.client import Binary

from specs.bundle_files import ContainerImage
from specs.errors import BundleRefused, LaunchRefused
from specs.launched_file import bundle_files, workspace_variables
from tasks.ros.launch.packages import RosInstallation, bundle_packages, make_gazebo_packages, ros_installation
from tasks.storage.image_files import image_command, inside, read_image


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
        simulation: It is the simulation application's.
        test: rostest would start it.
        named: Whether it is one node, of that name; what runs in a container image may be any.
        absent: Files of parameters that it is named and that are not there; ROS 2 starts it without.
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
    simulation: bool = False
    test: bool = False
    named: bool = True
    absent: tuple[str, ...] = ()

    @property
    def judges(self) -> bool:
        """Returns whether its end says how the episode ends."""
        return self.simulation and (self.required or self.test)

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
        lost: Nodes of the file whose program is not there, and why; an episode cannot run without.
        tests: Its test nodes, which rostest starts and roslaunch does not; each writes its results to ``results_file``.
        model: What Gazebo would call the robot.
    """

    file: str
    nodes: tuple[NodePlan, ...]
    parameters: dict[str, Any]
    lost: tuple[str, ...] = ()
    tests: tuple[NodePlan, ...] = ()
    model: str = ""


def joined_plan(robot: LaunchPlan | None, simulation: LaunchPlan) -> LaunchPlan | LaunchRefused:
    """Returns what both applications of an episode start, or why they cannot run together.

    Args:
        robot: The robot application's; None where there is none.
        simulation: The simulation application's, whose test nodes are started, too. The other's parameters win.
    """
    driving = robot.nodes if robot else ()
    judging = [node._replace(simulation=True) for node in simulation.nodes]
    judging += [node._replace(simulation=True, test=True) for node in simulation.tests]
    both = {node.name for node in driving} & {node.name for node in judging}
    if both:
        named = ", ".join(sorted(both))
        return LaunchRefused(f"both applications start {named}: ROS lets one node have a name; rename one of them")
    parameters = {**simulation.parameters, **(robot.parameters if robot else {})}
    return LaunchPlan(simulation.file, (*driving, *judging), parameters)


class ImageLaunch(NamedTuple):
    """What a container image runs in each episode.

    Attributes:
        root: Where it is unpacked.
        image: What it says of itself.
        words: What is run.
    """

    root: Path
    image: ContainerImage
    words: tuple[str, ...]

    @classmethod
    def of(cls, source: "LaunchSource", root: Path | None) -> Self | None:
        """Returns what is run of a bundle whose image is unpacked there; None for a bundle that is no image."""
        image = read_image(source.bundle)
        if image is None or root is None:
            return None
        return cls(root, image, image.words(source.package, source.launch_file, source.command))

    def ros2_variables(self) -> dict[str, str]:
        """Returns by which variables the ROS 2 inside is found from outside: folders, its release, its middleware."""
        told = self.image.environment.get("AMENT_PREFIX_PATH", "")
        found = [str(inside(self.root, each)) for each in told.split(":") if each]
        usual = ("opt/ros/*", "opt/*", "usr/local", "usr")
        found = found or [str(path) for name in usual for path in sorted(self.root.glob(name))]
        chosen = {name: value for name, value in self.image.environment.items() if name == "RMW_IMPLEMENTATION"}
        return {"AMENT_PREFIX_PATH": ":".join(found), **chosen}

    def plan(self, *, simulation: bool = False) -> LaunchPlan:
        """Returns the plan of its one process, which starts others."""
        name = "/simulation-image" if simulation else "/image"
        return LaunchPlan("", (NodePlan(name, "", "", self.words, named=False),), {})

    def entered(self, plan: LaunchPlan, variables: Mapping[str, str], home: Path) -> tuple[LaunchPlan, dict[str, str]]:
        """Returns a plan whose process runs in the image, and the environment that leads into it.

        Raises:
            LaunchRefused: bubblewrap is not installed, or the image does not have what is run.
        """
        try:
            command = image_command(self.root, self.image, self.words, variables, home)
        except BundleRefused as exc:
            raise LaunchRefused(str(exc)) from exc
        nodes = tuple(node._replace(command=command) for node in plan.nodes)
        # By this the processes are found, and no variable of the image's is told to programs outside it.
        return plan._replace(nodes=nodes), {"PATH": os.defpath, "ROS_HOME": str(home)}


_RESULTS = "test_results"


def node_stem(name: str) -> str:
    """Returns the name of a node's files."""
    return name.strip("/").replace("/", "-")


def results_file(home: Path, name: str) -> Path:
    """Returns where a test node writes its results as JUnit has them.

    Args:
        home: The episode's folder.
        name: The node's.
    """
    return home / _RESULTS / f"{node_stem(name)}.xml"


_MEMORY_BYTES = 4 << 30
# Of each file that it writes, what it prints among them.
_WRITTEN_BYTES = 64 << 20
# What it answers of an environment: robots' descriptions among the parameters have some megabytes.
_ANSWER_BYTES = 16 << 20
_LAST_BYTES = 4000


def run_launch_program(
    command: Sequence[str],
    environment: Mapping[str, str],
    folder: Path,
    text: str,
    limit_s: float,
    *,
    most_bytes: int = _ANSWER_BYTES,
) -> str:
    """Returns the last line that a program prints; what it prints before is not read.

    Args:
        command: Of the program.
        environment: All that it has.
        folder: Where it runs, and may write.
        text: What it reads.
        limit_s: How long it may take.
        most_bytes: Of the line.

    Raises:
        LaunchRefused: It cannot be started, takes too long, fails, or prints nothing or too much; says why.
    """
    with tempfile.TemporaryFile(dir=folder) as out, tempfile.TemporaryFile(dir=folder) as errors:
        try:
            process = subprocess.Popen(  # noqa: S603 - a program of Simyard's own
                [*_limits(), *command],
                env=environment,
                cwd=folder,
                stdin=subprocess.PIPE,
                stdout=out,
                stderr=errors,
                start_new_session=True,
            )
        except (OSError, ValueError) as exc:
            raise LaunchRefused(f"it cannot be started: {exc}") from exc
        if _status(process, text, limit_s):
            said = _last_bytes(errors, _LAST_BYTES).splitlines() or ["it says nothing"]
            raise LaunchRefused(f"it fails: {said[-1][:1000]}")
        last = _last_bytes(out, most_bytes).rpartition("\n")
        if not last[1] and out.seek(0, os.SEEK_END) > most_bytes:
            raise LaunchRefused(f"it answers with a line of more than {most_bytes:,} bytes")
    if not last[2]:
        raise LaunchRefused("it ends without an answer")
    return last[2]


def _status(process: "subprocess.Popen[bytes]", text: str, limit_s: float) -> int:
    """Returns how a program ended that is given a text; all that it leaves in its session is ended."""
    try:
        process.communicate(text.encode(), timeout=limit_s)
    except subprocess.TimeoutExpired as exc:
        raise LaunchRefused(f"reading it takes longer than {limit_s:g} s") from exc
    finally:
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return process.returncode


def _limits() -> tuple[str, ...]:
    program = shutil.which("prlimit")
    if program is None:
        return ()
    return (program, f"--as={_MEMORY_BYTES}", f"--fsize={_WRITTEN_BYTES}", "--core=0:0", "--")


def _last_bytes(file: IO[bytes], most_bytes: int) -> str:
    file.seek(max(0, file.seek(0, os.SEEK_END) - most_bytes))
    return file.read(most_bytes).decode("utf-8", "replace").strip()


# One thread each: many lanes share the machine's cores, and sums of floats keep their order.
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMEXPR_NUM_THREADS")
_WRITTEN = ("tmp", "log", "bin", _RESULTS)


def node_environment(
    installation: RosInstallation, bundle: Path, master_uri: str, home: Path, variables: Mapping[str, str]
) -> dict[str, str]:
    """Returns the whole environment of a node: nothing of this process's own is in it.

    Args:
        installation: The ROS that runs the node.
        bundle: Folder that holds the ROS packages.
        master_uri: Address of the episode's master.
        home: The episode's folder; see ``make_home``.
        variables: The episode's own; what ROS and lock-step need goes before them.
    """
    ros = installation.environment()
    return {
        **variables,
        **ros,
        "PATH": f"{home / 'bin'}:{ros['PATH']}",
        **workspace_variables(bundle, bundle_files(bundle), ros),
        **master_variables(master_uri),
        **episode_environment(home),
    }


def master_variables(master_uri: str) -> dict[str, str]:
    """Returns what leads nodes of ROS 1 to their master: all of an episode lies on one loopback device."""
    return {"ROS_MASTER_URI": master_uri, "ROS_IP": "127.0.0.1"}  # no name has to be looked up


def episode_environment(home: Path) -> dict[str, str]:
    """Returns what the processes of ROS 1 and of ROS 2 alike find in their environment.

    Args:
        home: The episode's folder; by its name in ``ROS_HOME`` they are found again.
    """
    return {
        "LANG": "C.UTF-8",
        "HOME": str(home),
        "TMPDIR": str(home / "tmp"),
        "ROS_HOME": str(home),
        "ROS_LOG_DIR": str(home / "log"),
        # A node's output is read as it comes, and its sets have one order in each episode.
        "PYTHONUNBUFFERED": "1",
        "PYTHONHASHSEED": "0",
        # Bundles are shared by episodes, and may be read-only.
        "PYTHONDONTWRITEBYTECODE": "1",
        **dict.fromkeys(_ONE_THREAD, "1"),
    }


def make_ros_home(home: Path, installation: RosInstallation) -> Path:
    """Makes the folder that an episode's nodes may write to, and returns it.

    A ``python`` lies in its ``bin``: scripts from before Noetic ask for it, and Debian has none.
    """
    for name in _WRITTEN:
        (home / name).mkdir(parents=True, exist_ok=True)
    with contextlib.suppress(FileExistsError):
        (home / "bin/python").symlink_to(installation.python)
    return home


PROGRAM = r'''
import base64, json, os, sys
import rospkg, roslaunch.config, roslaunch.core, roslaunch.node_args, roslaunch.xmlloader, xmlrpc.client


class Refused(Exception):
    pass


def launch_file(package, name):
    """Finds a launch file as roslaunch does: its path in the package, its launch folder, anywhere below."""
    try:
        folder = rospkg.RosPack(rospkg.get_ros_paths()).get_path(package)
    except rospkg.ResourceNotFound:
        raise Refused("there is no ROS package %r in the bundle or in ROS" % package)
    for path in (os.path.join(folder, name), os.path.join(folder, "launch", name)):
        if os.path.isfile(path):
            return path
    found = [
        os.path.join(root, each) for root, folders, files in sorted(os.walk(folder)) for each in files if each == name
    ]
    if len(found) > 1:
        raise Refused("%s has more than one %s: %s" % (package, name, ", ".join(sorted(found))))
    if not found:
        raise Refused("the package %s has no launch file %r" % (package, name))
    return found[0]


def words(exc):
    text = " ".join(str(exc).split()) or type(exc).__name__
    package, paths, _ = text.partition(" ROS path [0]=")
    if paths:
        package = package.rpartition(": ")[2]
        text = "there is no ROS package %r in the bundle or in ROS: put it into the bundle, or install it" % package
    return text.replace(os.environ.get("ROS_PACKAGE_PATH", "").split(":")[0] + "/", "")


def full_name(each):
    return each.namespace + (each.name or each.test_name)


def node(each, machine):
    # The resolved command holds the names that $(anon ...) stands for.
    command = roslaunch.node_args.create_local_process_args(each, machine)
    folder = ""
    if each.cwd == "node":
        prefix = len(each.launch_prefix.split()) if each.launch_prefix else 0
        folder = os.path.dirname(command[prefix])
    return {
        "name": full_name(each), "package": each.package, "kind": each.type, "command": command,
        "environment": [[str(name), str(value)] for name, value in each.env_args], "namespace": each.namespace,
        "cwd": folder, "required": bool(each.required), "respawn": bool(each.respawn),
    }


def binary(value):
    if isinstance(value, xmlrpc.client.Binary):
        return {"binary": base64.b64encode(value.data).decode()}
    raise Refused("a parameter is a %s, which no ROS parameter can be" % type(value).__name__)


def resolved(package, name):
    config, path = roslaunch.config.ROSLaunchConfig(), launch_file(package, name)
    loader = roslaunch.xmlloader.XmlLoader()
    # load_config_default sets it, and reads roscore.xml, of which nothing is started here.
    loader.ignore_unset_args = False
    loader.load(path, config, argv=[], verbose=False)
    if config.config_errors:
        raise Refused("; ".join(config.config_errors))
    commands = [each for each in getattr(config, "executables", []) if each is not None]
    if commands:
        raise Refused("<rosparam> with command dump or delete is not done: a new parameter server has nothing yet")
    for each in config.nodes:
        if each.machine_name:
            given = config.machines.get(each.machine_name)
            if given is None:
                raise Refused("node %s names the machine %r, which is not declared" % (each.name, each.machine_name))
            if given.address not in ("localhost", "127.0.0.1", "::1"):
                raise Refused(
                    "node %s is for the machine %s: all nodes of an episode run on one machine; "
                    "take the attribute machine away" % (each.name, given.address)
                )
    for each in config.tests:
        stem = full_name(each).strip("/").replace("/", "-")
        each.args = "%s --gtest_output=xml:test_results/%s.xml" % (each.args, stem)
    local, nodes, tests, lost = roslaunch.core.local_machine(), [], [], []
    for found, each in [(nodes, each) for each in config.nodes] + [(tests, each) for each in config.tests]:
        try:
            found.append(node(each, local))
        except roslaunch.node_args.NodeParamsException as exc:
            lost.append(["%s (%s %s)" % (full_name(each), each.package, each.type), words(exc)])
    return {
        "file": path, "nodes": nodes, "tests": tests, "lost": lost,
        "parameters": {key: param.value for key, param in config.params.items()},
    }


def answer(package, name, environment):
    os.environ.clear()
    os.environ.update(environment)
    try:
        return json.dumps(resolved(package, name), default=binary)
    except Exception as exc:
        # What roslaunch raises has no common root below Exception.
        return json.dumps({"refused": words(exc)})


answers = [answer(sys.argv[1], sys.argv[2], each) for each in json.load(sys.stdin)]
sys.stdout.write("\n" + json.dumps(answers))
'''


_LIMIT_S = 60.0
_MOST_NAMED = 8
_NO_NODE = re.compile(r"Cannot locate node of type \[(?P<kind>[\w.-]+)\] in package \[(?P<package>[\w.-]+)\]")


class LaunchSource(NamedTuple):
    """What decides what a launch file starts, besides the environment.

    Attributes:
        bundle: Folder that holds the ROS packages.
        package: The launch configuration's packageName.
        launch_file: Its launchFile.
        command: Of a container image: what is run in place of a launch file.
    """

    bundle: Path
    package: str
    launch_file: str
    command: tuple[str, ...] | None = None


def resolve_launch(source: LaunchSource, environments: Sequence[Mapping[str, str]]) -> list[LaunchPlan | LaunchRefused]:
    """Returns for each environment what a launch file starts, or why it cannot: each node that is lost is named.

    Raises:
        LaunchRefused: As ``read_launch`` says.
    """
    return [_complete(source, each) for each in read_launch(source, environments)]


def _complete(source: LaunchSource, plan: LaunchPlan | LaunchRefused) -> LaunchPlan | LaunchRefused:
    lost = plan.lost if isinstance(plan, LaunchPlan) else ()
    return LaunchRefused(f"{_name(source)}: {'; '.join(lost)}") if lost else plan


def read_launch(source: LaunchSource, environments: Sequence[Mapping[str, str]]) -> list[LaunchPlan | LaunchRefused]:
    """Returns for each environment what roslaunch reads in a launch file, or why it refuses it.

    Args:
        source: The launch file.
        environments: Episodes' environment variables, which ``$(env)`` and ``$(optenv)`` read.

    Raises:
        LaunchRefused: ROS is not here, or roslaunch does not answer.
    """
    installation = ros_installation()
    if installation.missing:
        raise LaunchRefused(installation.missing)
    keys = [tuple(sorted(each.items())) for each in environments]
    distinct = list(dict.fromkeys(keys))
    with tempfile.TemporaryDirectory(prefix="simyard-launch-") as folder:
        home = make_ros_home(Path(folder), installation)
        uri = "http://127.0.0.1:11311/"
        stand_ins = make_gazebo_packages(home / "gazebo")
        asked = [node_environment(installation, source.bundle, uri, home, dict(key)) for key in distinct]
        for each in asked:
            each["ROS_PACKAGE_PATH"] += f":{stand_ins}"
        answers = _answers(installation, source, home, asked)
    found = {key: _plan(source, answer) for key, answer in zip(distinct, answers, strict=True)}
    return [found[key] for key in keys]


def _answers(
    installation: RosInstallation, source: LaunchSource, home: Path, environments: list[dict[str, str]]
) -> list[str]:
    """Returns what roslaunch answers: imported once, it is asked for all environments."""
    command, where = [str(installation.python), "-c", PROGRAM, source.package, source.launch_file], _name(source)
    own = node_environment(installation, source.bundle, "", home, {})
    limit_s, most_bytes = _LIMIT_S + len(environments), len(environments) * _ANSWER_BYTES
    try:
        answer = run_launch_program(command, own, home, json.dumps(environments), limit_s, most_bytes=most_bytes)
        return json.loads(answer)
    except LaunchRefused as exc:
        raise LaunchRefused(f"{where}: roslaunch: {exc}") from exc
    except ValueError as exc:
        raise LaunchRefused(f"{where}: roslaunch answers what is no list of nodes") from exc


def _plan(source: LaunchSource, text: str) -> LaunchPlan | LaunchRefused:
    answer = json.loads(text)
    if "refused" in answer:
        return LaunchRefused(f"{_name(source)}: {answer['refused']}{_remedy(source, answer['refused'])}")
    nodes, tests = (tuple(_node(each) for each in answer[kind]) for kind in ("nodes", "tests"))
    lost = tuple(f"{node}: {why}{_remedy(source, why)}" for node, why in answer["lost"])
    if not (nodes or tests or lost):
        return LaunchRefused(f"{_name(source)}: it starts no node")
    parameters = {key: _value(value) for key, value in answer["parameters"].items()}
    return LaunchPlan(answer["file"], nodes, parameters, lost, tests)


def _remedy(source: LaunchSource, why: str) -> str:
    """Returns what to do about a node that roslaunch misses: git checkouts lose that a script is executable."""
    missed = _NO_NODE.match(why)
    folder = bundle_packages(source.bundle).get(missed["package"]) if missed else None
    if missed is None or folder is None:
        return ""
    found = [each for each in sorted(folder.rglob(missed["kind"])) if each.is_file() and not os.access(each, os.X_OK)]
    if found:
        return f"; it is there: chmod +x {found[0].relative_to(source.bundle)}"
    recipe = folder / "CMakeLists.txt"
    if recipe.is_file() and re.search(rf"\b{re.escape(missed['kind'])}\b", recipe.read_text("utf-8", "replace")):
        return "; its CMakeLists.txt has it: build it, catkin_make install, and bring the folder install in the bundle"
    have = sorted({each.name for each in folder.rglob("*") if each.is_file() and os.access(each, os.X_OK)})
    return f"; it has {', '.join(have[:_MOST_NAMED])}" if have else ""


def _name(source: LaunchSource) -> str:
    return f"{source.package} {source.launch_file}"


def _node(answer: dict[str, Any]) -> NodePlan:
    answer["command"] = tuple(answer["command"])
    answer["environment"] = tuple((name, value) for name, value in answer["environment"])
    return NodePlan(**answer)


def _value(value: Any) -> Any:  # noqa: ANN401 - what XML-RPC takes
    """Returns a parameter as XML-RPC takes it: bytes of a file are Binary again."""
    if isinstance(value, dict) and set(value) == {"binary"}:
        return Binary(base64.b64decode(value["binary"]))
    return value
