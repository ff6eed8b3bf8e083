"""How many connections there may be, and who gives way."""

from dataclasses import dataclass, field

from tasks.gateway.connections import Bounds, Connections


@dataclass(eq=False)
class Fake:
    dropped: list[bool] = field(default_factory=list[bool])

    def drop(self) -> None:
        self.dropped.append(True)


def test_who_waited_longest_gives_way() -> None:
    known = Connections(Bounds(open=10, of_client=2))
    first, second, third = Fake(), Fake(), Fake()
    assert all(known.admit(each, "10.0.0.1") for each in (first, second))
    known.wait(first)  # asked and was answered since
    assert known.admit(third, "10.0.0.1")
    assert (first.dropped, second.dropped, len(known)) == ([], [True], 2)


def test_who_is_being_answered_does_not_give_way() -> None:
    known = Connections(Bounds(open=10, of_client=1))
    first = Fake()
    known.admit(first, "10.0.0.1")
    known.busy(first)
    assert not known.admit(Fake(), "10.0.0.1")
    assert known.admit(Fake(), "10.0.0.2")
    known.forget(first)
    assert known.admit(Fake(), "10.0.0.1")


def test_one_client_does_not_take_the_places_of_others() -> None:
    known = Connections(Bounds(open=3, of_client=2))
    other = Fake()
    known.admit(other, "10.0.0.9")
    assert all(known.admit(Fake(), "10.0.0.1") for _ in range(10))
    assert not other.dropped


def test_a_network_of_ipv6_is_one_client() -> None:
    known = Connections(Bounds(open=10, of_client=1))
    first = Fake()
    known.admit(first, "2001:db8::1")
    known.admit(Fake(), "2001:db8::ffff:1")
    assert first.dropped
    known.admit(Fake(), "2001:db8:0:1::1")
    assert len(known) == 2


def test_two_addresses_of_ipv4_that_are_written_as_ipv6_are_two_clients() -> None:
    known = Connections(Bounds(open=10, of_client=1))
    assert known.admit(Fake(), "::ffff:10.0.0.1")
    assert known.admit(Fake(), "::ffff:10.0.0.2")
    assert len(known) == 2


def test_what_is_forgotten_leaves_nothing() -> None:
    known = Connections(Bounds())
    for _ in range(3):
        each = Fake()
        known.admit(each, "::ffff:10.0.0.1")
        known.forget(each)
        known.forget(each)
        known.wait(each)
    assert (len(known), known._counts, known._waiting) == (0, {}, {})
