"""The tree of parameters: as a dict of dicts would have it, within its bounds; what followers of a parameter hear."""

import copy
import xmlrpc.client
from typing import Any, cast

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from tasks.ros.graph import graph_limits
from tasks.ros.graph.parameter_tree import ParameterError, ParameterTree, change_for
from tasks.ros.graph.xml_rpc import Value, weight
from tests.ros.graph.episode import Episode, PlayedNode

PARTS = st.sampled_from(["a", "b", "c"])
NAMES = st.lists(PARTS, min_size=1, max_size=4)
LEAVES = st.booleans() | st.integers(-(2**31), 2**31 - 1) | st.floats(allow_nan=False) | st.text(max_size=5)
VALUES = st.recursive(
    LEAVES, lambda each: st.lists(each, max_size=3) | st.dictionaries(PARTS, each, max_size=3), max_leaves=6
)


def _name(parts: list[str]) -> str:
    return "/" + "/".join(parts)


class TreeMachine(RuleBasedStateMachine):
    """The tree beside a dict of dicts."""

    def __init__(self) -> None:
        super().__init__()
        self.tree = ParameterTree()
        self.model: dict[str, Any] = {}

    @rule(parts=NAMES, value=VALUES)
    def set_value(self, parts: list[str], value: Value) -> None:
        self.tree.set(_name(parts), value)
        below = self.model
        for part in parts[:-1]:
            if not isinstance(below.get(part), dict):
                below[part] = {}
            below = below[part]
        below[parts[-1]] = copy.deepcopy(value)

    @rule(value=st.dictionaries(PARTS, VALUES, max_size=3))
    def set_all(self, value: dict[str, Any]) -> None:
        self.tree.set("/", cast("Value", value))
        self.model = copy.deepcopy(value)

    @rule(parts=NAMES)
    def delete(self, parts: list[str]) -> None:
        below: Any = self.model
        for part in parts[:-1]:
            below = below.get(part) if isinstance(below, dict) else None
        if isinstance(below, dict) and parts[-1] in below:
            del below[parts[-1]]
            self.tree.delete(_name(parts))
        else:
            with pytest.raises(KeyError):
                self.tree.delete(_name(parts))

    @rule(parts=NAMES)
    def look_up(self, parts: list[str]) -> None:
        below: Any = self.model
        for part in parts:
            if not isinstance(below, dict) or part not in below:
                assert not self.tree.has(_name(parts))
                return
            below = below[part]
        assert self.tree.get(_name(parts)) == below

    @invariant()
    def holds_the_same(self) -> None:
        assert self.tree.get("/") == self.model
        assert all(self.tree.has(name) for name in self.tree.names())

    @invariant()
    def knows_its_size(self) -> None:
        assert self.tree._bytes == weight({"": self.tree.get("/")})


TestTree = TreeMachine.TestCase
TestTree.settings = settings(max_examples=20, stateful_step_count=20)


@given(name=NAMES, value=VALUES, followed=NAMES)
def test_a_follower_hears_what_it_would_read(name: list[str], value: Value, followed: list[str]):
    tree = ParameterTree()
    tree.set(_name(name), value)
    change = change_for(_name(followed), _name(name), value)
    if change is None:
        assert name[: len(followed)] != followed
        assert followed[: len(name)] != name
    elif change[0] == f"{_name(followed)}/":
        assert change[1] == (tree.get(_name(followed)) if tree.has(_name(followed)) else {})
    else:
        assert change == (f"{_name(name)}/", value)


def test_a_search_finds_the_innermost_namespace_that_has_the_first_part():
    tree = ParameterTree()
    tree.set("/robot/arm", 1)
    tree.set("/left/robot/base", 2)
    # The innermost wins, though only the outer one has the whole name.
    assert tree.search("robot/arm", "/left/camera") == "/left/robot/arm"
    assert tree.search("robot", "/right/camera") == "/robot"
    assert tree.search("/robot/arm", "/left/camera") == "/robot/arm"
    assert tree.search("legs", "/left/camera") is None
    tree.set("/left/camera/legs", 4)
    assert tree.search("legs", "/left/camera") == "/left/camera/legs"


def test_the_tree_keeps_a_copy():
    tree, value = ParameterTree(), cast("Value", {"a": [1]})
    tree.set("/x", value)
    cast("Any", value)["a"].append(2)
    assert tree.get("/x/a") == [1]


@pytest.mark.parametrize("value", [2**31, -(2**31) - 1, object(), None, {"a": None}, [2**40]])
def test_a_value_without_a_form_in_xml_rpc_is_refused(value: object):
    tree = ParameterTree()
    with pytest.raises(ParameterError, match="/x: "):
        tree.set("/x", cast("Value", value))
    assert tree.get("/") == {}


def test_a_value_of_too_many_levels_is_refused():
    value: Value = 1
    for _ in range(100):
        value = [value]
    with pytest.raises(ParameterError, match="64 levels"):
        ParameterTree().set("/x", value)


def test_the_root_is_a_mapping_and_stays():
    tree = ParameterTree()
    with pytest.raises(ParameterError, match="only a mapping"):
        tree.set("/", 1)
    with pytest.raises(ParameterError, match="cannot be deleted"):
        tree.delete("/")


def test_all_parameters_together_are_bounded(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(graph_limits, "PARAMETER_BYTES", 10_000)
    tree = ParameterTree()
    for _ in range(100):
        tree.set("/x", "a" * 5000)
        tree.set("/y/z", "a" * 500)
        tree.set("/y", "a" * 500)
    with pytest.raises(ParameterError, match="10000 are kept"):
        tree.set("/w", "a" * 6000)
    tree.delete("/x")
    tree.set("/w", "a" * 6000)


def test_values_come_back_as_they_were_set(episode: Episode):
    value = {"text": "ä <&>", "flag": True, "number": -3, "real": 0.5, "list": [1, "x", []], "empty": {}}
    assert episode.call("setParam", "/a/b", value)[0] == 1
    assert episode.call("getParam", "/a/b")[2] == value
    assert episode.call("getParam", "/a/b/list")[2] == [1, "x", []]
    assert episode.call("hasParam", "/a/b/c")[2] is False


def test_bytes_stay_bytes(episode: Episode):
    episode.call("setParam", "/blob", xmlrpc.client.Binary(b"\0\1"))
    assert episode.call("getParam", "/blob")[2].data == b"\0\1"


def test_private_and_relative_names_are_the_nodes_own(episode: Episode):
    episode.call("setParam", "~gain", 1, caller="/left/node")
    episode.call("setParam", "gain", 2, caller="/left/node")
    assert sorted(episode.call("getParamNames")[2]) == ["/left/gain", "/left/node/gain", "/use_sim_time"]
    assert episode.call("searchParam", "gain", caller="/left/node")[2] == "/left/node/gain"
    assert episode.call("searchParam", "gain", caller="/left/other")[2] == "/left/gain"


def test_a_node_hears_of_the_parameter_that_it_follows(episode: Episode):
    with PlayedNode() as node:
        assert episode.call("subscribeParam", node.uri, "/a")[2] == {}
        episode.call("setParam", "/a/b", 1, caller="/other")
        episode.call("setParam", "/a", {"b": 2}, caller="/other")
        episode.call("setParam", "/a", {"b": 3})
        episode.call("deleteParam", "/a", caller="/other")
        episode.serve_until(lambda: len(node.calls) == 3)
        # What it sets itself it knows.
        assert [each[2:] for each in node.calls] == [("/a/b/", 1), ("/a/", {"b": 2}), ("/a/", {})]
        assert episode.call("unsubscribeParam", node.uri, "/a")[2] == 1
        assert episode.graph.nodes() == set()


def test_a_parameter_that_the_simulation_sets_is_heard_as_well(episode: Episode):
    with PlayedNode() as node:
        episode.call("subscribeParam", node.uri, "/goal")
        episode.graph.set_parameter("/goal", [1.0, 2.0])
        episode.serve_until(lambda: bool(node.calls))
        assert node.calls == [("paramUpdate", "/master", "/goal/", [1.0, 2.0])]


def test_time_is_simulated(episode: Episode):
    assert episode.call("getParam", "/use_sim_time")[2] is True
