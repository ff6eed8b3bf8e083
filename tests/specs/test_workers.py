"""Where chunks are simulated, as the environment says."""

import pytest

from specs.errors import DocumentError
from specs.settings import WORKERS, Workers, chosen_workers


@pytest.mark.parametrize(
    ("text", "workers"),
    [
        ("", None),
        ("dask", Workers(kind="dask")),
        ("ray", Workers(kind="ray")),
        ("dask:2", Workers(kind="dask", count=2)),
        ("ray:16", Workers(kind="ray", count=16)),
        ("tcp://10.0.0.7:8786", Workers(kind="dask", address="tcp://10.0.0.7:8786")),
        ("tls://scheduler.dask:8786", Workers(kind="dask", address="tls://scheduler.dask:8786")),
        ("ray://head:10001", Workers(kind="ray", address="ray://head:10001")),
    ],
)
def test_a_kind_a_count_or_an_address_says_where(
    text: str, workers: Workers | None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(WORKERS, text)
    assert chosen_workers() == workers


@pytest.mark.parametrize("text", ["dask:0", "spark", "dask:two", "http://head:8786", "tcp://head", "dask:2 ray:2"])
def test_anything_else_is_refused_with_what_there_is(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(WORKERS, text)
    with pytest.raises(DocumentError, match=r"SIMYARD_WORKERS.*tcp://host:8786"):
        chosen_workers()
