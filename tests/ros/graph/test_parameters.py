"""Parameters as nodes see them: over XML-RPC, with updates of those that they follow."""

import xmlrpc.client

from tests.ros.graph.episode import Episode, PlayedNode


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
