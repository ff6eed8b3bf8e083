"""The brake: five wrong secrets are free, then each costs more time, and addresses do not share a fate."""

from concurrent.futures import ThreadPoolExecutor

from tasks.gateway.page.session import LoginRateLimit


def waits(brake: LoginRateLimit, tries: int, address: str = "a", now_s: float = 0.0) -> list[float]:
    return [brake.begin(address, now_s) for _ in range(tries)]


def test_five_mistakes_are_free():
    assert waits(LoginRateLimit(), 7) == [0, 0, 0, 0, 0, 2, 2]


def test_each_further_mistake_doubles_the_pause_up_to_five_minutes():
    brake, now_s, pauses = LoginRateLimit(), 0.0, list[float]()
    waits(brake, 5)
    for _ in range(12):
        pauses.append(brake.begin("a", now_s))
        now_s += pauses[-1]
        assert brake.begin("a", now_s) == 0
    assert pauses == [2, 4, 8, 16, 32, 64, 128, 256, 300, 300, 300, 300]


def test_who_waits_for_a_quarter_of_an_hour_begins_anew():
    brake = LoginRateLimit()
    waits(brake, 5)
    assert waits(brake, 5, now_s=901) == [0] * 5


def test_one_address_does_not_slow_another():
    brake = LoginRateLimit()
    waits(brake, 9)
    assert brake.begin("b", 0.0) == 0


def test_the_right_secret_makes_good_for_mistakes():
    brake = LoginRateLimit()
    waits(brake, 4)
    brake.forgive("a")
    assert waits(brake, 5) == [0] * 5


def test_many_tries_at_once_are_no_way_around():
    brake = LoginRateLimit()
    with ThreadPoolExecutor(16) as pool:
        free = sum(wait == 0 for wait in pool.map(lambda _: brake.begin("a", 0.0), range(200)))
    assert free == 5


def test_its_memory_is_bounded():
    brake = LoginRateLimit()
    for number in range(10_000):
        brake.begin(str(number), 0.0)
    assert waits(brake, 6, "0")[-1] == 2
