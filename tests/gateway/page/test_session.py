"""Sessions: who has the key's secret made them, nobody else, and not for ever; and how often one may guess."""

import base64
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tasks.gateway.page.session import (
    LIFE_S,
    EndedSessions,
    LoginRateLimit,
    cookie_value,
    matches,
    new_session,
    open_session,
    seal_session,
)

NOW_S = 1_800_000_000.0
KEYS = {"SIMYARD1": "one secret", "SIMYARD2": "another secret"}


def sealed(key_id: str = "SIMYARD1", now_s: float = NOW_S) -> str:
    return seal_session(new_session(key_id, now_s), KEYS[key_id])


def test_a_session_opens_with_the_secret_that_it_was_made_with():
    session = open_session(sealed(), KEYS.get, NOW_S)
    assert session is not None
    assert session.key_id == "SIMYARD1"


def test_a_session_ends():
    assert open_session(sealed(), KEYS.get, NOW_S + LIFE_S) is not None
    assert open_session(sealed(), KEYS.get, NOW_S + LIFE_S + 1) is None


def test_a_session_of_tomorrow_is_none():
    assert open_session(sealed(now_s=NOW_S + 3600), KEYS.get, NOW_S) is None


def test_a_session_does_not_become_another_keys():
    assert open_session(sealed().replace("SIMYARD1", "SIMYARD2"), KEYS.get, NOW_S) is None


def test_a_session_does_not_become_longer():
    assert open_session(sealed(now_s=NOW_S - LIFE_S - 9).replace("|1", "|2", 1), KEYS.get, NOW_S) is None


def test_the_secret_itself_is_no_key_of_a_session():
    # A signature of a request, which is made from the secret too, must never be one of a session.
    body = sealed().rpartition(".")[0]
    for mac in ("", "AA", base64.urlsafe_b64encode(b"one secret").decode()):
        assert open_session(f"{body}.{mac}", KEYS.get, NOW_S) is None


def test_no_byte_of_a_session_can_be_changed():
    value = sealed()
    for at in range(len(value) - 1):  # the last sign has bits that mean nothing
        other = "A" if value[at] != "A" else "B"
        assert open_session(f"{value[:at]}{other}{value[at + 1 :]}", KEYS.get, NOW_S) is None


@given(st.text(max_size=300))
def test_no_text_is_a_session_by_chance(value: str):
    assert open_session(value, KEYS.get, NOW_S) is None


@pytest.mark.parametrize("header", ["", "simyard", "a=b", 'simyard="', "simyard=x; simyard", "\x00", "=" * 9000])
def test_any_header_of_cookies_can_be_read(header: str):
    assert cookie_value(header, "simyard") in {"", "x", '"'}


def test_an_ended_session_is_known_as_such():
    ended, session = EndedSessions(), new_session("SIMYARD1", NOW_S)
    assert session not in ended
    ended.end(session)
    assert session in ended
    assert new_session("SIMYARD1", NOW_S) not in ended


def test_an_unknown_key_matches_no_secret():
    assert matches("one secret", "one secret")
    assert not matches("one secret", "one secret ")
    assert not matches(None, "")
    assert not matches("", "")


def waits(limit: LoginRateLimit, tries: int, address: str = "a", now_s: float = 0.0) -> list[float]:
    return [limit.begin(address, now_s) for _ in range(tries)]


def test_five_mistakes_are_free():
    assert waits(LoginRateLimit(), 7) == [0, 0, 0, 0, 0, 2, 2]


def test_each_further_mistake_doubles_the_pause_up_to_five_minutes():
    limit, now_s, pauses = LoginRateLimit(), 0.0, list[float]()
    waits(limit, 5)
    for _ in range(12):
        pauses.append(limit.begin("a", now_s))
        now_s += pauses[-1]
        assert limit.begin("a", now_s) == 0
    assert pauses == [2, 4, 8, 16, 32, 64, 128, 256, 300, 300, 300, 300]


def test_who_waits_for_a_quarter_of_an_hour_begins_anew():
    limit = LoginRateLimit()
    waits(limit, 5)
    assert waits(limit, 5, now_s=901) == [0] * 5


def test_one_address_does_not_slow_another():
    limit = LoginRateLimit()
    waits(limit, 9)
    assert limit.begin("b", 0.0) == 0


def test_the_right_secret_makes_good_for_mistakes():
    limit = LoginRateLimit()
    waits(limit, 4)
    limit.forgive("a")
    assert waits(limit, 5) == [0] * 5


def test_many_tries_at_once_are_no_way_around():
    limit = LoginRateLimit()
    with ThreadPoolExecutor(16) as pool:
        free = sum(wait == 0 for wait in pool.map(lambda _: limit.begin("a", 0.0), range(200)))
    assert free == 5


def test_its_memory_is_bounded():
    limit = LoginRateLimit()
    for number in range(10_000):
        limit.begin(str(number), 0.0)
    assert waits(limit, 6, "0")[-1] == 2
