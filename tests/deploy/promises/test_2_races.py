"""Of many that create one object exactly one wins, and who won is never told otherwise."""

from collections.abc import Callable

import pytest

from specs.errors import ObjectExists
from tasks.storage.base.store import Store
from tasks.storage.store_url import open_store
from tests.deploy.promises.figures import Figures, kind, sizes
from tests.servers.faulty_proxy import faulty_proxy
from tests.servers.racers import create_in_rounds, in_processes
from tests.servers.seaweed import Seaweed

pytestmark = pytest.mark.integration
_PROCESSES, _THREADS = 10, 5
_QUEUES = {"file": 1, "s3": 10}  # SeaweedFS queues who writes one key, and takes half a minute for fifty


@sizes(short=1, long=200)
def test_of_fifty_creators_exactly_one_wins_each_round(store: Store, size: int, figures: Figures) -> None:
    rounds = max(1, size // _QUEUES[kind(store.url)])
    processes = _PROCESSES if rounds > 1 else 2  # with all of them the contract of stores tries it
    racers = [(store.url, racer, _THREADS, rounds) for racer in range(processes)]

    wins = [win for won in in_processes(create_in_rounds, racers) for win in won]

    assert sorted(number for number, _ in wins) == list(range(rounds))
    assert all(store.get(f"race/{number}").body.decode() == winner for number, winner in wins)
    figures(2, kind(store.url), rounds=rounds, creators=processes * _THREADS, several_winners=0)


@sizes(short=3, long=200)
def test_who_lost_the_answer_has_not_lost_the_race(
    s3_url: Callable[[], str], seaweed: Seaweed, size: int, figures: Figures, monkeypatch: pytest.MonkeyPatch
) -> None:
    near = open_store(s3_url())
    with faulty_proxy(seaweed.endpoint) as proxy:
        monkeypatch.setenv("AWS_ENDPOINT_URL_S3", proxy.endpoint)
        far = open_store(near.url)
        for number in range(size):
            if number % 20 == 0:  # botocore repeats no more than so many requests out of hand (its retry quota)
                far = open_store(near.url)
            proxy.lose_the_next_answer()
            etag = far.create(f"mine/{number}", f"far {number}".encode())
            assert near.get(f"mine/{number}").etag == etag
            near.create(f"theirs/{number}", b"near")
            proxy.lose_the_next_answer()
            with pytest.raises(ObjectExists):
                far.create(f"theirs/{number}", b"near")
        assert proxy.lost == 2 * size
    figures(2, "s3", answers_lost=2 * size, false_losers=0, false_winners=0)
