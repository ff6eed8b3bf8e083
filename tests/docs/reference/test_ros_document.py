"""docs/reference/ros.md: its topics, types, services and limits are those of the code."""

import re

import pytest

from specs.ros_robot import RosTopics
from tasks.ros.graph import graph, graph_limits
from tasks.ros.message import ros_messages
from tasks.ros.message.definition import MESSAGES
from tests.repository import ROOT

PAGE = (ROOT / "docs/reference/ros.md").read_text()
LIMITS = {
    "announces a command": graph_limits.COMMAND_MESSAGE_BYTES,
    "sends more commands": graph_limits.COMMAND_BYTES,
    "leaves more of a topic": graph_limits.BACKLOG_BYTES,
    "its nodes hold": graph_limits.CONNECTIONS,
    "more nodes publish": graph_limits.PUBLISHERS,
    "its connections make": graph_limits.BUFFERED_BYTES,
    "nodes of an": graph_limits.NODES,
    "the XML of a call": graph_limits.BODY_BYTES,
    "the header of a request": graph_limits.HEADER_BYTES,
    "a request to a service": ros_messages.REQUEST_BYTES,
    "calls within": graph_limits.CALLS,
    "registrations of": graph_limits.REGISTRATIONS,
    "all parameters": graph_limits.PARAMETER_BYTES,
    "namespaces, lists": graph_limits.PARAMETER_DEPTH,
    "characters of": graph_limits.NAME_CHARACTERS,
}
UNITS = {"": 1, " KiB": 1024, " MiB": 1024**2}


def test_the_table_has_every_topic_that_a_robot_has_by_default():
    named = {topic for topic in RosTopics().model_dump().values() if topic}
    rows = dict(re.findall(r"^\| `?(.+?)`?(?: in `ros.yaml`)? \| `(\w+/\w+)` \|", PAGE, re.MULTILINE))
    assert {topic for topic in rows if topic.startswith("/") and "robomaker" not in topic} == named | {
        "/clock",
        "/tf",
        "/tf_static",
    }
    assert {kind for topic, kind in rows.items() if "robomaker" not in topic} <= set(MESSAGES)
    assert {topic: kind for topic, kind in rows.items() if "robomaker" in topic} == dict(graph.SERVICES)


@pytest.mark.parametrize("what", LIMITS)
def test_a_limit_is_the_codes(what: str):
    found = re.search(rf"^\| (?:it )?{what}.* \| (\d+)( [KM]iB)? \|$", PAGE, re.MULTILINE)
    assert found is not None
    assert int(found[1]) * UNITS[found[2] or ""] == LIMITS[what]
    assert f"not complete after {graph_limits.REQUEST_S:g} s" in PAGE
