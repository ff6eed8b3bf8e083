"""Events of assets: their keys are what Prefect takes, without secrets; their ids are the same whoever sends them."""

import logging
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prefect.assets import Asset as PrefectAsset

from flows.pipeline.stage_report import Asset, MadeAsset
from flows.prefect import prefect_events
from flows.prefect.prefect_events import MATERIALIZED, REFERENCED, announce_asset, asset_key

WORLDS, COURIER = Asset("s3://b/p/worlds/wgj-1", "worlds of wgj-1"), Asset("s3://b/p/bundles/f9", "courier 1")
TABLES = MadeAsset(Asset("s3://b/p/simb-1/results.parquet", "results of simb-1"), (WORLDS, COURIER), {"episodes": 8})
Sent = list[tuple[str, dict[str, str], dict[str, Any]]]


@pytest.fixture
def sent(monkeypatch: pytest.MonkeyPatch) -> Sent:
    """Returns what is sent, instead of sending it."""
    found: Sent = []
    monkeypatch.setattr(
        prefect_events, "emit_event", lambda event, resource, **more: found.append((event, resource, more))
    )
    return found


def test_what_was_made_names_its_sources_and_its_figures(sent: Sent):
    announce_asset(TABLES)
    event, resource, more = sent[-1]
    assert event == MATERIALIZED
    assert resource == {"prefect.resource.id": TABLES.asset.url, "prefect.resource.name": "results of simb-1"}
    assert [each["prefect.resource.id"] for each in more["related"]] == [WORLDS.url, COURIER.url, "simyard"]
    assert more["payload"] == {"episodes": 8}


def test_each_source_is_referenced(sent: Sent):
    announce_asset(TABLES)
    assert [(event, each["prefect.resource.name"]) for event, each, _ in sent[:-1]] == [
        (REFERENCED, "worlds of wgj-1"),
        (REFERENCED, "courier 1"),
    ]


def test_the_same_asset_has_the_same_ids_however_often_it_is_told(sent: Sent):
    announce_asset(TABLES)
    announce_asset(TABLES)
    ids = [more["id"] for _, _, more in sent]
    assert ids[:3] == ids[3:]
    assert len(set(ids)) == 3


def test_what_was_made_anew_with_other_figures_is_told_again(sent: Sent):
    announce_asset(TABLES)
    announce_asset(TABLES._replace(facts={"episodes": 9}))
    told = [more["id"] for event, _, more in sent if event == MATERIALIZED]
    assert len(set(told)) == 2


def test_a_source_of_two_things_is_referenced_by_both(sent: Sent):
    announce_asset(TABLES)
    announce_asset(TABLES._replace(asset=Asset("s3://b/p/other", "other")))
    assert len({more["id"] for _, _, more in sent}) == len(sent)


def test_an_event_that_cannot_be_sent_harms_no_job(monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture):
    def refuse(*_: object, **__: object) -> None:
        raise RuntimeError("no route")

    monkeypatch.setattr(prefect_events, "emit_event", refuse)
    with caplog.at_level(logging.WARNING, logger="flows.prefect.prefect_events"):
        announce_asset(TABLES)
    assert "results of simb-1 was made: no route" in caplog.text


def test_a_key_is_the_url_where_prefect_takes_it():
    assert asset_key("s3://bucket/a/results.parquet") == "s3://bucket/a/results.parquet"


def test_a_key_has_no_secret():
    key = asset_key("s3://me:secret@bucket/a?token=secret#secret")
    assert key.startswith("s3://bucket/a-")
    assert "secret" not in key
    assert "me" not in key


URLS = st.text(max_size=600).map(lambda text: f"file:///{text}") | st.text("a %&_", max_size=8).map("file:///{}".format)


@given(URLS)
def test_prefect_takes_every_key(url: str):
    assert PrefectAsset(key=asset_key(url)).key.startswith("file:///")


@given(URLS, URLS)
def test_two_paths_never_have_the_same_key(url: str, other: str):
    assert (asset_key(url) == asset_key(other)) == (_plain(url) == _plain(other))


def _plain(url: str) -> str:
    return url.partition("#")[0].partition("?")[0]
