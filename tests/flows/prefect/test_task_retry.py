"""Prefect runs a step again when the store was away, and for nothing else."""

import os
from collections.abc import Callable, Generator
from typing import Any

import pytest
from prefect import flow, task
from prefect.settings import PREFECT_API_AUTH_STRING, PREFECT_API_URL, temporary_settings

from flows.prefect.tasks import RETRY_DELAYS_S, TASK_OPTIONS
from specs.base import Fault
from specs.errors import BucketNotFound, DocumentError, StageFailed, StoreAway, StoreThrottled

pytestmark = pytest.mark.integration


@pytest.fixture(autouse=True)
def _on_the_server(prefect_server: str) -> Generator[None, None, None]:  # pyright: ignore[reportUnusedFunction]
    password = os.environ["PREFECT_API_AUTH_STRING"]
    chosen: dict[Any, str] = {PREFECT_API_URL: prefect_server, PREFECT_API_AUTH_STRING: password}
    with temporary_settings(chosen):
        yield


def calls_until_the_end(failure: Exception, times: int) -> int:
    """Returns how often Prefect called a step that fails so many times."""
    calls = 0
    options: dict[str, Any] = {**TASK_OPTIONS, "retry_delay_seconds": 0}

    @task(**options)
    def step() -> None:
        nonlocal calls
        calls += 1
        if calls <= times:
            raise failure

    @flow(persist_result=False)
    def stage() -> None:
        step()

    try:
        stage()
    except type(failure):
        return -calls
    return calls


@pytest.mark.parametrize("failure", [StoreAway("away"), StoreThrottled("slow down")])
def test_a_store_that_comes_back_ends_the_step_well(failure: Exception):
    assert calls_until_the_end(failure, 2) == 3


def test_a_store_that_stays_away_fails_the_step_in_the_end():
    assert calls_until_the_end(StoreAway("away"), 99) == -1 - len(RETRY_DELAYS_S)


REFUSALS: list[Callable[[], Exception]] = [
    lambda: DocumentError([Fault(path="a", value="1", allowed="2")]),
    lambda: StageFailed("InvalidInput", "no worlds"),
    lambda: BucketNotFound("there is no bucket"),
]


@pytest.mark.parametrize("failure", REFUSALS)
def test_what_nobody_but_a_person_can_change_is_not_tried_again(failure: Callable[[], Exception]):
    assert calls_until_the_end(failure(), 1) == -1
