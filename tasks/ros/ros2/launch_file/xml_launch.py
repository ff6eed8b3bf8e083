"""Launch files of ROS 2 in XML, as the entities that the same file in Python would make.

Tags, attributes and substitutions as documented by ROS 2's packages launch_xml and launch_ros. What is not done is
refused by its name.
"""

import itertools
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from xml.etree.ElementTree import Element

from specs.errors import LaunchRefused
from tasks.ros.launch.packages import plain_xml
from tasks.ros.ros2.launch_file import actions, node_actions, substitutions
from tasks.ros.ros2.launch_file.actions import Entity, LaunchDescription
from tasks.ros.ros2.launch_file.substitutions import IfCondition, NotDone, Substitution, UnlessCondition

_NAMES: Mapping[str, Callable[..., Substitution]] = {
    "var": lambda name, default=None: substitutions.LaunchConfiguration(name, default=default),
    "env": lambda name, default=None: substitutions.EnvironmentVariable(name, default_value=default),
    "find-pkg-share": substitutions.FindPackageShare,
    "find-pkg-prefix": substitutions.FindPackagePrefix,
    "find-exec": lambda name: substitutions.FindExecutable(name=name),
    "file-content": substitutions.FileContent,
    "dirname": substitutions.ThisLaunchFileDir,
    "filename": substitutions.ThisLaunchFile,
    "eval": substitutions.PythonExpression,
    "command": lambda words, on_stderr="fail": substitutions.Command(words, on_stderr=on_stderr),
    "not": substitutions.NotSubstitution,
    "and": substitutions.AndSubstitution,
    "or": substitutions.OrSubstitution,
    "equals": substitutions.EqualsSubstitution,
    "not-equals": substitutions.NotEqualsSubstitution,
}
_TYPES = {"bool": bool, "int": int, "float": float, "str": str}
_TRUE = {"true": True, "1": True, "false": False, "0": False}
_MOST_BYTES = 1 << 20


def described_xml(path: Path) -> LaunchDescription:
    """Returns what a launch file in XML describes.

    Raises:
        NotDone: It is no XML, or has what is not done.
    """
    if path.stat().st_size > _MOST_BYTES:
        raise NotDone(f"{path}: more than {_MOST_BYTES} bytes")
    try:
        root = plain_xml(path.read_bytes(), path.name, "launch file")
    except LaunchRefused as exc:
        raise NotDone(str(exc)) from exc
    if root.tag != "launch":
        raise NotDone(f"{path.name}: its outermost element is <{root.tag}>, not <launch>")
    return LaunchDescription(map(_entity, root))


def _entity(element: Element) -> Entity:
    """Returns what an element stands for."""
    make = _ENTITIES.get(element.tag.replace("-", "_"))
    if make is None:
        raise NotDone(f"<{element.tag}> is not done: install ROS 2, or take it out of the launch file")
    given = {name.replace("-", "_"): text for name, text in element.attrib.items()}
    conditions = [IfCondition(_text(given.pop("if")))] if "if" in given else []
    conditions += [UnlessCondition(_text(given.pop("unless")))] if "unless" in given else []
    entity = make(element, given)
    return actions.GroupAction([entity], scoped=False, condition=conditions[0]) if conditions else entity


def _text(text: str) -> list[Substitution]:
    """Returns a text of an attribute as substitutions: ``$(name words)``, one within another."""
    found: list[Substitution] = []
    while (begin := text.find("$(")) >= 0:
        end = _end(text, begin + 2)
        found += [substitutions.TextSubstitution(text=text[:begin]), _substitution(text[begin + 2 : end])]
        text = text[end + 1 :]
    return [*found, substitutions.TextSubstitution(text=text)]


# As launch has them: a quotation may hold its own sign behind a backslash.
_QUOTED = re.compile(r"'(?:\\.|[^'\\])*'|\"(?:\\.|[^\"\\])*\"")


def _end(text: str, begin: int) -> int:
    """Returns where the substitution ends that begins there."""
    depth, place = 1, begin
    while place < len(text):
        if quoted := _QUOTED.match(text, place):
            place = quoted.end()
            continue
        depth += (text[place] == "(") - (text[place] == ")")
        if not depth:
            return place
        place += 1
    raise NotDone(f"{text!r}: a substitution does not end")


def _substitution(text: str) -> Substitution:
    name, *words = _words(text)
    if name not in _NAMES:
        raise NotDone(f"$({name}) is not done: install ROS 2, or write its value out")
    try:
        return _NAMES[name](*map(_text, words))
    except TypeError as exc:
        raise NotDone(f"$({text}): {exc}") from exc


def _words(text: str) -> list[str]:
    """Returns the words of a substitution; one in quotes is one word, and so is a substitution."""
    found, place = list[str](), 0
    while place < len(text):
        if text[place].isspace():
            place += 1
        elif quoted := _QUOTED.match(text, place):
            found.append(re.sub(r"\\(.)", r"\1", quoted[0][1:-1]))
            place = quoted.end()
        else:
            begin = place
            while place < len(text) and not text[place].isspace():
                place = _end(text, place + 2) + 1 if text.startswith("$(", place) else place + 1
            found.append(text[begin:place])
    return found or [""]


def _pairs(element: Element, tag: str, names: tuple[str, str]) -> list[tuple[list[Substitution], list[Substitution]]]:
    """Returns two attributes of each child with a tag."""
    return [(_text(_needed(each, names[0])), _text(_needed(each, names[1]))) for each in element.findall(tag)]


def _needed(element: Element, name: str) -> str:
    if name not in element.attrib:
        raise NotDone(f"<{element.tag}> has no {name}")
    return element.attrib[name]


def _parameters(element: Element) -> list[object]:
    """Returns the parameters of a node, files and values by name: of two that say something, the later one counts."""
    found = list[object]()
    for is_file, those in itertools.groupby(element.findall("param"), lambda each: "from" in each.attrib):
        if is_file:
            found += [_text(each.attrib["from"]) for each in those]
        else:
            found.append({_needed(each, "name"): _value(each) for each in those})
    return found


def _value(element: Element) -> object:
    if inner := element.findall("param"):
        return {_needed(each, "name"): _value(each) for each in inner}
    kind = element.attrib.get("type")
    return node_actions.ParameterValue(_text(_needed(element, "value")), value_type=_TYPES.get(kind or ""))


def _process(element: Element, given: dict[str, str]) -> dict[str, object]:
    """Returns what nodes and executables have in common."""
    found: dict[str, object] = {"additional_env": dict[object, object]()}
    environment = [(_needed(each, "name"), _text(_needed(each, "value"))) for each in element.findall("env")]
    found["additional_env"] = dict(environment)
    for name, own in (("name", "name"), ("cwd", "cwd"), ("launch_prefix", "prefix")):
        if name in given:
            found[own] = _text(given[name])
    if given.get("on_exit") == "shutdown":
        found["on_exit"] = node_actions.Shutdown()
    found["respawn"] = _TRUE.get(given.get("respawn", "false").lower(), False)
    return found


def _node(element: Element, given: dict[str, str]) -> Entity:
    more = {name: _text(given[name]) for name in ("namespace",) if name in given}
    return node_actions.Node(
        package=_text(_needed(element, "pkg")),
        executable=_text(_needed(element, "exec")),
        parameters=_parameters(element),
        remappings=_pairs(element, "remap", ("from", "to")),
        arguments=list(map(_text, _words(given["args"]))) if given.get("args") else None,
        ros_arguments=list(map(_text, _words(given["ros_args"]))) if given.get("ros_args") else None,
        **more,
        **_process(element, given),
    )


def _executable(element: Element, given: dict[str, str]) -> Entity:
    shell = _TRUE.get(given.get("shell", "false").lower(), False)
    command = _needed(element, "cmd")
    words = [_text(command)] if shell else list(map(_text, _words(command)))
    return node_actions.ExecuteProcess(cmd=words, shell=shell, **_process(element, given))  # pyright: ignore[reportArgumentType] - each is what its name says


def _argument(element: Element, given: dict[str, str]) -> Entity:
    default = _text(given["default"]) if "default" in given else None
    return actions.DeclareLaunchArgument(_needed(element, "name"), default_value=default)


def _include(element: Element, _: dict[str, str]) -> Entity:
    arguments = [pair for tag in ("arg", "let") for pair in _pairs(element, tag, ("name", "value"))]
    return actions.IncludeLaunchDescription(_text(_needed(element, "file")), launch_arguments=arguments)


def _group(element: Element, given: dict[str, str]) -> Entity:
    return actions.GroupAction(map(_entity, element), scoped=_TRUE.get(given.get("scoped", "true").lower(), True))


def _set(make: Callable[..., Entity], *names: str) -> Callable[[Element, dict[str, str]], Entity]:
    return lambda element, _: make(*(_text(_needed(element, name)) for name in names))


_ENTITIES: Mapping[str, Callable[[Element, dict[str, str]], Entity]] = {
    "arg": _argument,
    "let": _set(actions.SetLaunchConfiguration, "name", "value"),
    "include": _include,
    "group": _group,
    "node": _node,
    "executable": _executable,
    "set_env": _set(actions.SetEnvironmentVariable, "name", "value"),
    "unset_env": _set(actions.UnsetEnvironmentVariable, "name"),
    "append_env": _set(actions.AppendEnvironmentVariable, "name", "value"),
    "push_ros_namespace": _set(node_actions.PushRosNamespace, "namespace"),
    "set_parameter": lambda element, _: node_actions.SetParameter(_needed(element, "name"), _value(element)),
    "set_remap": _set(node_actions.SetRemap, "from", "to"),
    "set_use_sim_time": lambda element, _: node_actions.SetUseSimTime(_value(element)),
    "log": lambda element, _: actions.LogInfo(msg=_needed(element, "message")),
}
