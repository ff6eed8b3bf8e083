"""Whatever a node calls, and with whatever arguments, it gets an answer, and the graph keeps its invariants."""

import asyncio
import xmlrpc.client
from collections.abc import Iterator

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.ros.graph import xml_rpc
from tasks.ros.graph.graph import Graph
from tests.ros.graph.episode import PUBLISHES, SUBSCRIBES
from tests.ros.graph.test_xml_rpc import VALUES

NAMES = st.sampled_from(["/a", "/b", "~c", "d", "/cmd_vel", "/clock"])
CALLERS = st.sampled_from(["/one", "/two", "/space/three"])
TYPES = st.sampled_from(["a/B", "*", "geometry_msgs/Twist"])
# Port 9 discards: nobody listens there.
URIS, SERVICES = st.sampled_from(["http://h:9/", "http://g:9/"]), st.sampled_from(["rosrpc://h:9", "rosrpc://g:9"])
ARGUMENTS = {
    "registerPublisher": (NAMES, TYPES, URIS),
    "unregisterPublisher": (NAMES, URIS),
    "registerSubscriber": (NAMES, TYPES, URIS),
    "unregisterSubscriber": (NAMES, URIS),
    "registerService": (NAMES, SERVICES, URIS),
    "unregisterService": (NAMES, SERVICES),
    "lookupService": (NAMES,),
    "lookupNode": (NAMES,),
    "setParam": (NAMES, VALUES),
    "getParam": (NAMES,),
    "deleteParam": (NAMES,),
    "searchParam": (NAMES,),
    "subscribeParam": (URIS, NAMES),
    "unsubscribeParam": (URIS, NAMES),
    "hasParam": (NAMES,),
    "requestTopic": (NAMES, VALUES),
    "getPublishedTopics": (NAMES,),
    "publisherUpdate": (NAMES, VALUES),
    "paramUpdate": (NAMES, VALUES),
    "shutdown": (NAMES,),
}
PLAIN = (
    *("getPid", "getUri", "getTopicTypes", "getSystemState", "getParamNames", "getBusInfo", "getBusStats"),
    *("getMasterUri", "getPublications", "getSubscriptions", "system.multicall", "nonsense"),
)
FITTING = st.sampled_from(sorted(ARGUMENTS)).flatmap(
    lambda method: st.tuples(st.just(method), st.tuples(CALLERS, *ARGUMENTS[method]).map(list))
)
ANY = st.tuples(st.sampled_from([*ARGUMENTS, *PLAIN]), st.lists(CALLERS | NAMES | VALUES, max_size=5))
CALLS = FITTING | ANY


@pytest.fixture(scope="module")
def graph() -> Iterator[Graph]:
    """One graph for all examples; its loop never runs, so that nothing is really called."""
    loop = asyncio.new_event_loop()
    made = Graph(loop, PUBLISHES, SUBSCRIBES)
    yield made
    made.close()
    loop.close()


@given(calls=st.lists(CALLS, max_size=20))
def test_any_call_is_answered(graph: Graph, calls: list[tuple[str, list[xml_rpc.Value]]]):
    for method, arguments in calls:
        answers: list[bytes] = []
        graph._dispatch.answer(xml_rpc.write_call(method, tuple(arguments)), answers.append)
        # The answer to a publisher of commands is held.
        if method == "registerPublisher" and not answers:
            continue
        try:
            ((code, message, _),), _ = xml_rpc.read_xml(answers[0])  # pyright: ignore[reportGeneralTypeIssues] - a fault's shape fails the test
        except xmlrpc.client.Fault:
            assert method == "system.multicall"
            continue
        assert code in (-1, 0, 1)
        assert isinstance(message, str)
        state = graph._tables
        registered = {
            node
            for table in (state.publishers, state.subscribers, state.followers)
            for _, each in table.state()
            for node in each
        }
        registered |= {each.node for each in state.services.values()}
        assert registered == set(state.nodes)
