"""A request that changes something is taken once."""

import pytest

from specs.errors import AccessRefused
from tasks.gateway.access.signature import UsedSignatures

ONE, OTHER = "ab" * 32, "cd" * 32


def test_a_signature_is_used_once() -> None:
    used = UsedSignatures()
    used.use(ONE, 0)
    used.use(OTHER, 1)
    with pytest.raises(AccessRefused, match="sent before"):
        used.use(ONE, 2)


def test_an_equal_request_of_the_same_second_may_be_a_retry_and_is_told_to_come_later() -> None:
    used = UsedSignatures()
    used.use(ONE, 0)
    codes: list[str] = []
    for now_s in (0.5, 1.9, 2.1, 600):
        with pytest.raises(AccessRefused, match="sent before") as caught:
            used.use(ONE, now_s)
        codes.append(caught.value.code)
    assert codes == ["ThrottlingException"] * 2 + ["InvalidSignatureException"] * 2


def test_it_is_remembered_for_as_long_as_it_is_good() -> None:
    used = UsedSignatures()
    used.use(ONE, 0)
    with pytest.raises(AccessRefused, match="sent before"):
        used.use(ONE, 600)
    used.use(ONE, 601)


def test_what_could_not_be_remembered_is_refused() -> None:
    used = UsedSignatures(most=1)
    used.use(ONE, 0)
    with pytest.raises(AccessRefused, match="wait") as caught:
        used.use(OTHER, 1)
    assert caught.value.code == "ThrottlingException"
    used.use(OTHER, 601)
