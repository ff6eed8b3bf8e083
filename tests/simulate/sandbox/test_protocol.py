"""Messages come out as they went in; what is none is refused, and nothing of it is run."""

import json
import socket
import struct
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from tasks.simulate.sandbox.protocol import MessageRefused, log_of, log_parts, receive, send
from tests.ros.bag.tracks import log

Pair = tuple[socket.socket, socket.socket]
NUMBERS = st.sampled_from([np.dtype(name) for name in ("?", "u1", "i4", "i8", "f4", "f8")])
ARRAYS = NUMBERS.flatmap(lambda dtype: arrays.arrays(dtype, arrays.array_shapes(min_dims=0, max_dims=3, min_side=0)))


@pytest.fixture
def pair() -> Iterator[Pair]:
    ours, theirs = socket.socketpair()
    with ours, theirs:
        yield ours, theirs


@given(st.dictionaries(st.text(), st.integers() | st.text()), st.lists(ARRAYS, max_size=4))
def test_what_is_sent_is_received(document: dict[str, int | str], sent: list[np.ndarray]):
    ours, theirs = socket.socketpair()
    with ours, theirs:
        send(theirs, document, sent)
        message = receive(ours)
    assert message.document == document
    assert [(each.dtype, each.shape, each.tobytes()) for each in message.arrays] == [
        (each.dtype, each.shape, each.tobytes()) for each in sent
    ]


def test_a_document_that_is_json_already_is_received_as_what_it_says(pair: Pair):
    ours, theirs = pair
    send(theirs, json.dumps({"a": [1.5, "é", None]}), [np.ones(2)])
    message = receive(ours)
    assert (message.document, len(message.arrays)) == ({"a": [1.5, "é", None]}, 1)


def _raw(connection: socket.socket, head: bytes, rest: bytes = b"", length: int | None = None) -> None:
    connection.sendall(struct.pack("<QQ", len(head) if length is None else length, len(rest)) + head + rest)


@pytest.mark.parametrize(
    "arrays_",
    [
        [{"dtype": "|O", "shape": [1]}],
        [{"dtype": "<f4", "shape": [-1]}],
        [{"dtype": "<f4", "shape": [3]}],
        [{"dtype": "<f4", "shape": [10**30]}],
        [{"dtype": "nothing", "shape": []}],
        [{}],
        "many",
        [{"dtype": "<f4", "shape": [0]}] * 100,
    ],
)
def test_arrays_that_are_none_are_refused(pair: Pair, arrays_: object):
    ours, theirs = pair
    _raw(theirs, json.dumps({"document": {}, "arrays": arrays_}).encode(), b"12345678")
    with pytest.raises(MessageRefused):
        receive(ours)


@pytest.mark.parametrize("head", [b"", b"null", b"[" * 5000, b"\xff", b'{"document": 3, "arrays": []}', b"{}"])
def test_documents_that_are_none_are_refused(pair: Pair, head: bytes):
    ours, theirs = pair
    _raw(theirs, head)
    with pytest.raises(MessageRefused):
        receive(ours)


def test_a_message_of_impossible_length_is_refused_unread(pair: Pair):
    ours, theirs = pair
    _raw(theirs, b"{}", length=1 << 62)
    with pytest.raises(MessageRefused):
        receive(ours)


def test_an_end_in_the_middle_is_told(pair: Pair):
    ours, theirs = pair
    _raw(theirs, b"{}", length=100)
    theirs.close()
    with pytest.raises(EOFError):
        receive(ours)


def test_a_log_comes_back_as_it_was():
    assert log_of(*log_parts(log())) == log()


@pytest.mark.parametrize("which", range(4))
def test_parts_that_do_not_fit_together_are_refused(which: int):
    topics, arrays = log_parts(log())
    arrays[which] = arrays[which][:-1]
    with pytest.raises(MessageRefused, match="do not fit together"):
        log_of(topics, arrays)


def test_a_topic_that_there_is_not_is_refused():
    topics, arrays = log_parts(log())
    arrays[1] = np.full_like(arrays[1], len(topics))
    with pytest.raises(MessageRefused, match="do not fit together"):
        log_of(topics, arrays)
