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

from tasks.simulate.plan.chunks import plan_chunks
from tasks.simulate.sandbox.protocol import (
    QUESTION,
    AuditWork,
    Bounds,
    LanesWork,
    MessageRefused,
    ReplayWork,
    SentWorlds,
    answer_bounds,
    log_of,
    log_parts,
    receive,
    send,
)
from tests.factories.simulations import delivery
from tests.ros.bag.tracks import SAMPLES, log

STEPS = SAMPLES - 1
ANY = QUESTION._replace(array_bytes=1 << 32)
BOUNDS = Bounds(json_bytes=30_000, values=6_000, array_bytes=1 << 20)
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
        message = receive(ours, ANY)
    assert message.document == document
    assert [(each.dtype, each.shape, each.tobytes()) for each in message.arrays] == [
        (each.dtype, each.shape, each.tobytes()) for each in sent
    ]


def test_a_document_that_is_json_already_is_received_as_what_it_says(pair: Pair):
    ours, theirs = pair
    send(theirs, json.dumps({"a": [1.5, "é", None]}), [np.ones(2)])
    message = receive(ours, ANY)
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
        receive(ours, BOUNDS)


@pytest.mark.parametrize("head", [b"", b"null", b"[" * 5000, b"\xff", b'{"document": 3, "arrays": []}', b"{}"])
def test_documents_that_are_none_are_refused(pair: Pair, head: bytes):
    ours, theirs = pair
    _raw(theirs, head)
    with pytest.raises(MessageRefused):
        receive(ours, BOUNDS)


class Counted:
    """A connection that gives what it has, and notes the most that was asked for at once."""

    def __init__(self, sent: bytes) -> None:
        self.sent, self.read, self.asked = sent, 0, 0

    def recv(self, most: int, /) -> bytes:
        self.asked = max(self.asked, most)
        piece = self.sent[self.read : self.read + most]
        self.read += len(piece)
        return piece


@pytest.mark.parametrize("lengths", [(30_001, 0), (1 << 29, 0), (1 << 62, 0), (2, 1 + (1 << 20)), (2, 1 << 31)])
def test_a_message_that_announces_more_than_was_asked_for_is_refused_unread(lengths: tuple[int, int]):
    """On 1b6713fb 16 bytes that announced a length took 630 MB."""
    source = Counted(struct.pack("<QQ", *lengths) + b"{}")
    with pytest.raises(MessageRefused, match=r"at most 30,000 and 1,048,576 were asked for"):
        receive(source, BOUNDS)
    assert (source.read, source.asked) == (16, 16)


def test_what_is_allowed_and_only_announced_is_not_asked_for_at_once():
    source = Counted(struct.pack("<QQ", 1 << 30, 0) + b"{}")
    with pytest.raises(EOFError):
        receive(source, QUESTION)
    assert source.asked <= 1 << 20


@pytest.mark.parametrize("value", [b"[]", b"{}", b"0"])
def test_a_document_of_more_values_than_were_asked_for_is_refused_unparsed(value: bytes):
    """Each takes some hundred bytes of memory: on 1b6713fb 16 MB of JSON took 410 MB."""
    head = b'{"document":{"a":[' + b",".join([value] * 6001) + b'],"b' + b'"},"arrays":[]}'  # and is no JSON
    with pytest.raises(MessageRefused, match=r"values: at most 6,000 were asked for"):
        receive(Counted(struct.pack("<QQ", len(head), 0) + head), BOUNDS)


def works(episodes: int, duration_s: float = 60.0) -> dict[str, LanesWork | AuditWork | ReplayWork]:
    (chunk,) = plan_chunks(
        [delivery(k, world="hand/apartment-0", duration_s=duration_s) for k in range(episodes)], 1000
    )
    rest = {"worlds": SentWorlds(new={}), "bundles": {}, "lanes": episodes, "engine": "auto"}
    lanes = {"numbers": (0,), "new": (chunk,)}
    return {
        "lanes": LanesWork.model_validate(lanes | rest),
        "recorded lanes": LanesWork.model_validate(lanes | rest | {"rate_hz": 1.0}),
        "lanes recorded often": LanesWork.model_validate(lanes | rest | {"rate_hz": 20.0}),
        "audit": AuditWork.model_validate({"here": chunk.requests, "others": chunk.requests} | rest),
        "replay": ReplayWork.model_validate({"request": chunk.requests[0], "rate_hz": 1.0} | rest),
    }


def bounds(name: str, episodes: int = 8, duration_s: float = 60.0) -> Bounds:
    work = works(episodes, duration_s)[name]
    return answer_bounds(work, work.new[0].requests if isinstance(work, LanesWork) else ())


@pytest.mark.parametrize("name", [name for name in works(1) if name != "replay"])
def test_more_episodes_may_be_answered_with_more(name: str):
    assert all(less < more for less, more in zip(bounds(name, 8), bounds(name, 16), strict=True))


@pytest.mark.parametrize("name", [*works(1)])
def test_longer_episodes_may_be_answered_with_more(name: str):
    less, more = bounds(name), bounds(name, duration_s=600.0)
    assert less.array_bytes <= more.array_bytes
    assert less.values < more.values


def test_only_who_is_asked_for_samples_may_send_them():
    assert bounds("lanes").array_bytes < 8 << 20
    assert bounds("lanes") < bounds("recorded lanes") < bounds("lanes recorded often")


def test_an_end_in_the_middle_is_told(pair: Pair):
    ours, theirs = pair
    _raw(theirs, b"{}", length=100)
    theirs.close()
    with pytest.raises(EOFError):
        receive(ours, BOUNDS)


def test_a_log_comes_back_as_it_was():
    assert log_of(*log_parts(log()), STEPS) == log()


@pytest.mark.parametrize("which", range(4))
def test_parts_that_do_not_fit_together_are_refused(which: int):
    topics, arrays = log_parts(log())
    arrays[which] = arrays[which][:-1]
    with pytest.raises(MessageRefused, match="do not fit together"):
        log_of(topics, arrays, STEPS)


def test_a_log_of_more_messages_than_its_steps_have_is_refused():
    with pytest.raises(MessageRefused, match="do not fit together"):
        log_of(*log_parts(log()), 0)


def test_a_topic_that_there_is_not_is_refused():
    topics, arrays = log_parts(log())
    arrays[1] = np.full_like(arrays[1], len(topics))
    with pytest.raises(MessageRefused, match="do not fit together"):
        log_of(topics, arrays, STEPS)
