"""The master's API: registrations, look-ups, and what nodes hear of each other."""

import pytest

from tests.ros.graph.episode import Episode, PlayedNode


def test_the_robot_is_a_node_with_its_topics_and_services(episode: Episode):
    published, subscribed, services = episode.call("getSystemState")[2]
    assert published == [["/clock", ["/simyard"]], ["/scan", ["/simyard"]], ["/map", ["/simyard"]]]
    assert subscribed == [["/cmd_vel", ["/simyard"]]]
    assert ["/robomaker/job/cancel", ["/simyard"]] in services
    assert episode.call("lookupNode", "/simyard") == [1, "/simyard", episode.graph.uri]


def test_topics_have_the_types_that_their_publishers_say(episode: Episode):
    episode.call("registerSubscriber", "/chat", "*", "http://127.0.0.1:1/")
    assert "/chat" not in dict(episode.call("getTopicTypes")[2])
    episode.call("registerPublisher", "/chat", "std_msgs/String", "http://127.0.0.1:1/")
    assert ["/chat", "std_msgs/String"] in episode.call("getPublishedTopics", "")[2]
    assert episode.call("getPublishedTopics", "/cha")[2] == []


def test_a_subscriber_hears_of_publishers_in_their_order(episode: Episode):
    with PlayedNode() as node:
        assert episode.call("registerSubscriber", "/chat", "std_msgs/String", node.uri)[2] == []
        uris = [f"http://127.0.0.1:{port}/" for port in range(1, 21)]
        for number, uri in enumerate(uris):
            episode.call("registerPublisher", "/chat", "std_msgs/String", uri, caller=f"/talker{number}")
        episode.serve_until(lambda: len(node.calls) == 20)
        assert [each[3] for each in node.calls] == [uris[: count + 1] for count in range(20)]


def test_a_node_of_the_same_name_takes_the_others_place(episode: Episode):
    with PlayedNode() as old, PlayedNode() as new:
        episode.call("registerPublisher", "/chat", "std_msgs/String", old.uri)
        episode.call("registerService", "/say", "rosrpc://127.0.0.1:5", old.uri)
        episode.call("registerSubscriber", "/news", "std_msgs/String", new.uri)
        episode.serve_until(lambda: bool(old.calls))
        assert old.calls[0][0] == "shutdown"
        assert episode.call("lookupNode", "/node")[2] == new.uri
        assert episode.call("lookupService", "/say")[0] == -1
        assert episode.graph.publishers("/chat") == set()
        code, message, _ = episode.call("subscribeParam", old.uri, "/a")
        assert (code, message) == (-1, "a new node has the same name, /node")


def test_a_node_without_registrations_is_gone(episode: Episode):
    uri = "http://127.0.0.1:1/"
    episode.call("registerPublisher", "/chat", "std_msgs/String", uri)
    episode.call("registerService", "/say", "rosrpc://127.0.0.1:5", uri)
    assert episode.call("unregisterPublisher", "/chat", uri)[2] == 1
    assert episode.graph.nodes() == {"/node"}
    assert episode.call("unregisterService", "/say", "rosrpc://127.0.0.1:5")[2] == 1
    assert episode.graph.nodes() == set()
    assert episode.call("lookupNode", "/node")[0] == -1


def test_only_the_one_that_registered_takes_a_registration_back(episode: Episode):
    episode.call("registerPublisher", "/chat", "std_msgs/String", "http://127.0.0.1:1/")
    assert episode.call("unregisterPublisher", "/chat", "http://127.0.0.1:2/")[2] == 0
    assert episode.call("unregisterPublisher", "/chat", "http://127.0.0.1:1/", caller="/other")[2] == 0
    assert episode.graph.publishers("/chat") == {"/node"}


def test_the_last_provider_of_a_service_has_it(episode: Episode):
    for name, port in (("/a", 5), ("/b", 6)):
        episode.call("registerService", "/say", f"rosrpc://127.0.0.1:{port}", f"http://127.0.0.1:{port}/", caller=name)
    assert episode.call("lookupService", "/say")[2] == "rosrpc://127.0.0.1:6"
    assert episode.call("unregisterService", "/say", "rosrpc://127.0.0.1:5", caller="/a")[2] == 0
    assert episode.graph.nodes() == {"/b"}


def test_a_multicall_answers_each_call(episode: Episode):
    calls = [
        {"methodName": "getUri", "params": ["/node"]},
        {"methodName": "getParam", "params": ["/node", "/none"]},
        {"methodName": "nonsense", "params": ["/node"]},
    ]
    (uri,), (unset,), (unknown,) = episode.during(getattr(episode.master, "system.multicall"), calls)
    assert uri == [1, "", episode.graph.uri]
    assert unset[0] == unknown[0] == -1


@pytest.mark.parametrize(
    ("method", "arguments", "fault"),
    [
        ("registerPublisher", (7, "a/B", "http://h:1/"), "topic must be a text"),
        ("registerPublisher", ("/", "a/B", "http://h:1/"), "topic cannot be /"),
        ("registerPublisher", ("/a b", "a/B", "http://h:1/"), "no colon, space"),
        ("registerPublisher", ("http://h:1/", "a/B", "http://h:1/"), "no colon, space"),
        ("registerPublisher", ("/a", "String", "http://h:1/"), "package/Name"),
        ("registerPublisher", ("/a", "a/B", "rosrpc://h:1"), "http://HOST:PORT/"),
        ("registerPublisher", ("/a", "a/B", "http://h:99999/"), "http://HOST:PORT/"),
        ("registerPublisher", ("/" + "a" * 2000, "a/B", "http://h:1/"), "characters"),
        ("registerPublisher", ("/a", "a/B"), "3 arguments: 4 are taken"),
        ("registerService", ("/s", "http://h:1/", "http://h:1/"), "rosrpc://HOST:PORT"),
        ("lookupService", ("/none",), "nobody provides /none"),
        ("searchParam", ("~a",), "no private name"),
        ("deleteParam", ("/none",), "is not set"),
        ("setParam", ("/a", None), "is missing"),
        ("nonsense", (), "no method"),
    ],
)
def test_a_fault_of_the_caller_says_what_is_wrong(episode: Episode, method: str, arguments: tuple[object], fault: str):
    code, message, _ = episode.call(method, *arguments)
    assert code == -1
    assert fault in message


def test_nobody_takes_the_robots_name(episode: Episode):
    assert episode.call("registerPublisher", "/a", "a/B", "http://127.0.0.1:1/", caller="/simyard")[0] == -1
    assert episode.call("lookupNode", "/simyard")[2] == episode.graph.uri


def test_names_are_resolved_as_the_caller_means_them(episode: Episode):
    uri = "http://127.0.0.1:1/"
    for name in ("chat", "~chat", "/chat//x/"):
        episode.call("registerPublisher", name, "a/B", uri, caller="/space/node")
    topics = {topic for topic, nodes in episode.call("getSystemState")[2][0] if "/space/node" in nodes}
    assert topics == {"/space/chat", "/space/node/chat", "/chat/x"}


def test_counters_tell_of_calls_and_registrations(episode: Episode):
    served, changes = episode.graph.served, episode.graph.changes
    episode.call("getUri")
    assert (episode.graph.served > served, episode.graph.changes) == (True, changes)
    episode.call("registerPublisher", "/a", "a/B", "http://127.0.0.1:1/")
    assert episode.graph.changes > changes
    assert episode.graph.busy == 0


def test_what_nodes_say_or_wait_for_in_vain_is_named(episode: Episode):
    uri, twist = "http://127.0.0.1:1/", "geometry_msgs/Twist"
    for topic in ("/base", "/mux"):
        episode.call("registerPublisher", topic, twist, uri)
    for topic in ("/mux", "/camera", "/scan"):
        episode.call("registerSubscriber", topic, "*", uri, caller="/other")
    assert episode.graph.gaps() == [
        f"/node publishes {twist} on /base, to which nobody subscribes",
        "/other subscribes to /camera, which nobody publishes",
    ]
