"""Links that a stranger puts into a store in a folder: neither a page nor a call goes where they lead.

Each method of the store, and a folder that becomes a link meanwhile: tests/storage/backends/test_local.py. S3 has none.
"""

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.factories.gateway.served import Served, served

pytestmark = [pytest.mark.integration, pytest.mark.long]
CREDENTIALS = "dXNlcjpwYXNzd29yZA"


@pytest.fixture(scope="module")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    with served(tmp_path_factory.mktemp("linked") / "s") as found:
        yield found


@pytest.fixture
def home(tmp_path: Path) -> Path:
    (tmp_path / "config.json").write_text(f'{{"auths": {{"registry.example": {{"auth": "{CREDENTIALS}"}}}}}}')
    return tmp_path


def test_a_key_that_may_read_templates_reads_no_credentials_of_the_owner(gateway: Served, home: Path) -> None:
    (gateway.store / "templates").symlink_to(home)
    cookie = gateway.signed_in(gateway.key("reader", "read"))
    pages = [gateway.page(target, cookie)[1] for target in ("/templates/config", "/templates")]
    assert [text for text in pages if CREDENTIALS in text or ">config<" in text] == []


def test_nobody_has_the_gateway_write_elsewhere(gateway: Served, home: Path) -> None:
    before = sorted(home.rglob("*"))
    (gateway.store / "fleets").symlink_to(home)
    status, error = gateway.send(gateway.signed("/createFleet", b'{"name": "owned"}'))
    assert (status, error) == (500, "InternalServerException")
    assert sorted(home.rglob("*")) == before
    assert CREDENTIALS in (home / "config.json").read_text()
