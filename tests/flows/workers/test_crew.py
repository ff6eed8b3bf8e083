"""How many workers there are, as a flow asks for it."""

import pytest

from flows.prefect import worker_cluster


def test_a_scheduler_is_asked_once_a_second_however_often_the_flow_asks(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, asked = [100.0], list[int]()

    def count() -> int:
        asked.append(1)
        return len(asked)

    monkeypatch.setattr(worker_cluster.time, "monotonic", lambda: now_s[0])
    width = worker_cluster._once_a_second(count)
    assert [width(), width(), width()] == [1, 1, 1]
    now_s[0] += 1.0
    assert [width(), width()] == [2, 2]
