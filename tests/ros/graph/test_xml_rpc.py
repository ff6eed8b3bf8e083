"""Headers, calls and heads of HTTP: what is written is read, and any bytes are read or refused."""

import asyncio
import contextlib
import socket
import xmlrpc.client
from typing import cast

import h11
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.ros.graph import xml_rpc
from tasks.ros.graph.event_loop import Connection, EventLoop
from tasks.ros.graph.parameter_tree import GraphNameError, check_name, resolve_name
from tasks.ros.graph.topic import HeaderError, take_header, write_header
from tasks.ros.graph.xml_rpc import HttpError, HttpMessage, Value, XmlRpcError, node_port

KEYS = st.text(max_size=20).filter(lambda key: "=" not in key)
# XML 1.0 has no control characters, and reads a carriage return as the end of a line.
TEXTS = st.text(st.characters(exclude_categories=("Cs", "Cc"), exclude_characters="\ufffe\uffff"), max_size=20)
VALUES = st.recursive(
    st.booleans() | st.integers(-(2**31), 2**31 - 1) | st.floats(allow_nan=False) | TEXTS | st.binary(max_size=20),
    lambda each: st.lists(each, max_size=3) | st.dictionaries(TEXTS, each, max_size=3),
    max_leaves=8,
)
BOMB = b"""<?xml version="1.0"?><!DOCTYPE b [<!ENTITY a "aaaaaaaaaa"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;">]>
<methodCall><methodName>getParam</methodName><params><param><value>&b;</value></param></params></methodCall>"""


@given(fields=st.dictionaries(KEYS, st.text(max_size=20), max_size=6), rest=st.binary(max_size=8))
def test_a_header_reads_as_it_was_written(fields: dict[str, str], rest: bytes):
    data = bytearray(write_header(fields) + rest)
    for cut in (0, 3, len(data) - len(rest) - 1):
        assert take_header(bytearray(data[:cut])) is None
    assert take_header(data) == fields
    assert bytes(data) == rest


@given(data=st.binary(max_size=80))
def test_any_bytes_are_a_header_or_none(data: bytes):
    with contextlib.suppress(HeaderError):
        take_header(bytearray(len(data).to_bytes(4, "little") + data))


def test_a_header_of_gigabytes_is_refused_before_it_comes():
    with pytest.raises(HeaderError, match="4294967295 bytes"):
        take_header(bytearray(b"\xff\xff\xff\xff"))


@given(arguments=st.lists(VALUES, max_size=4))
def test_a_call_reads_as_it_was_written(arguments: list[Value]):
    assert xml_rpc.read_xml(xml_rpc.write_call("setParam", tuple(arguments))) == (tuple(arguments), "setParam")
    assert xml_rpc.read_xml(xml_rpc.write_answer(arguments)) == ((arguments,), None)


@given(data=st.binary(max_size=80) | st.text("<>/?!&;ab value int struct").map(str.encode))
def test_any_bytes_are_a_call_or_none(data: bytes):
    with contextlib.suppress(XmlRpcError, xmlrpc.client.Fault):
        xml_rpc.read_xml(data)


@pytest.mark.parametrize(
    "data",
    [
        BOMB,
        b"",
        b"<methodCall>",
        b"<methodCall><methodName>a</methodName><params><param><value><int>x</int></value></param></params></methodCall>",
        b"<methodResponse><params><param><value><struct><member></member></struct></value></param></params>",
        b'<?xml version="1.0" encoding="no-such"?><methodCall/>',
        b"<methodCall><methodName>a</methodName><params><param>"
        + b"<value><array><data>" * 200
        + b"</data></array></value>" * 200
        + b"</param></params></methodCall>",
    ],
)
def test_what_is_no_call_is_refused(data: bytes):
    with pytest.raises(XmlRpcError):
        xml_rpc.read_xml(data)


def test_a_document_type_is_refused_by_its_name():
    with pytest.raises(XmlRpcError, match="document type"):
        xml_rpc.read_xml(BOMB)


def test_an_answer_without_a_form_becomes_a_fault():
    with pytest.raises(xmlrpc.client.Fault, match="no form in XML-RPC"):
        xml_rpc.read_xml(xml_rpc.write_answer(cast("Value", [2**40])))


def read_request(data: bytes) -> bytes | None:
    """Returns the body of a request that comes over a connection."""
    ours, theirs = socket.socketpair()
    loop = asyncio.new_event_loop()
    with ours, theirs, contextlib.closing(loop):
        connection = Connection(EventLoop(loop, socket.socket), ours, lambda: None, lambda: None)
        connection.incoming += data
        try:
            return HttpMessage(h11.SERVER, connection).read()
        finally:
            connection.drop()


@given(data=st.binary(max_size=80).map(lambda data: data + b"\r\n\r\n"))
def test_any_bytes_are_a_request_or_none(data: bytes):
    with contextlib.suppress(HttpError):
        read_request(data)


@pytest.mark.parametrize(
    ("field", "status"),
    [
        ("Content-Length: x", 400),
        ("Content-Length: -1", 400),
        ("Content-Length: ²", 400),
        ("Content-Length: 1\r\nContent-Length: 2", 400),
        ("Content-Length: 99999999999999999999", 413),
        ("Content-Length: " + "9" * 10_000, 400),
        ("Transfer-Encoding: chunked", 501),
        ("no colon", 400),
    ],
)
def test_a_head_that_does_not_say_how_long_its_body_is_is_refused(field: str, status: int):
    with pytest.raises(HttpError) as caught:
        read_request(f"POST / HTTP/1.1\r\nHost: x\r\n{field}\r\n\r\n".encode("latin-1"))
    assert caught.value.status == status


def test_a_head_that_never_ends_is_refused():
    with pytest.raises(HttpError) as caught:
        read_request(b"POST / HTTP/1.1\r\n" + b"a" * 70_000)
    assert caught.value.status == 431


@pytest.mark.parametrize(
    ("name", "meant"),
    [
        ("/a/b", "/a/b"),
        ("a", "/space/a"),
        ("~a", "/space/node/a"),
        ("~/a", "/space/node/a"),
        ("/", "/"),
        ("//a///b/", "/a/b"),
        ("~", "/space/node"),
    ],
)
def test_a_name_is_resolved_as_ros_does(name: str, meant: str):
    assert resolve_name(name, "/space/node") == meant


@given(name=st.text(max_size=30), node=st.text(max_size=30))
def test_a_resolved_name_is_absolute_and_stays(name: str, node: str):
    resolved = resolve_name(name, node)
    assert resolved.startswith("/")
    assert resolve_name(resolved, "/other/node") == resolved


@pytest.mark.parametrize("name", [None, 3, [], "", "a b", "a:b", "a\nb", "a\x00b", "a" * 1025])
def test_a_name_that_no_graph_takes_is_refused(name: object):
    with pytest.raises(GraphNameError, match="topic"):
        check_name(name, "topic")


@pytest.mark.parametrize("uri", ["", "http://", "http://h/", "http://h:0/", "http://h:65536", "https://h:1/", "h:1"])
def test_an_address_that_is_none_is_refused(uri: str):
    with pytest.raises(ValueError, match="http://HOST:PORT/"):
        node_port(uri)
