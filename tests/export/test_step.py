"""The sheet of a job is drawn once and kept, and shown with what could not be made."""

import base64
import re
from xml.etree import ElementTree as ET

import pytest

from specs.base import canonical_document, canonical_json
from specs.errors import DocumentError, ResourceNotFound
from tasks.export.picture.contact_sheet import MOST_WORLDS
from tasks.export.step import keep_contact_sheet, sheet_markdown
from tasks.storage.base.keys import contact_sheet_key, world_key
from tasks.storage.base.store import Store
from tests.factories.worlds import apartment

GENERATION = "wgj-0000000000000001"
WORLDS = tuple(apartment(generation=GENERATION, name=f"world-{number}-1") for number in (1, 2))
REFERENCES = [f"{GENERATION}/{world.name}" for world in WORLDS]


@pytest.fixture
def filled(file_store: Store) -> Store:
    for world in WORLDS:
        file_store.create(world_key(GENERATION, world.name), canonical_json(canonical_document(world)))
    return file_store


def test_the_sheet_is_kept_beside_the_worlds(filled: Store):
    sheet = keep_contact_sheet(filled, GENERATION, REFERENCES)
    assert filled.get(contact_sheet_key(GENERATION)).body == sheet
    assert b"world-2-1" in sheet


def test_a_sheet_that_is_there_is_not_drawn_again(filled: Store):
    filled.create(contact_sheet_key(GENERATION), b"as it was")
    assert keep_contact_sheet(filled, GENERATION, [f"{GENERATION}/gone"]) == b"as it was"


def test_only_the_worlds_that_are_drawn_are_read(filled: Store):
    many = [REFERENCES[0]] * MOST_WORLDS + [f"{GENERATION}/world-{number}-1" for number in range(100, 9_000)]
    assert f"the first {MOST_WORLDS} of {len(many)} worlds".encode() in keep_contact_sheet(filled, GENERATION, many)


def test_a_world_that_is_missing_is_named(filled: Store):
    with pytest.raises(ResourceNotFound, match="world-9-9"):
        keep_contact_sheet(filled, GENERATION, [f"{GENERATION}/world-9-9"])


def test_a_world_of_another_version_is_named(filled: Store):
    filled.create(world_key(GENERATION, "world-old"), b'{"version": "0"}')
    with pytest.raises(DocumentError, match="world-old"):
        keep_contact_sheet(filled, GENERATION, [f"{GENERATION}/world-old"])


def test_the_page_holds_the_very_sheet_and_says_where_it_lies(filled: Store):
    sheet = keep_contact_sheet(filled, GENERATION, REFERENCES)
    page = sheet_markdown(sheet, "file:///store/sheet.svg", {})
    (encoded,) = re.findall(r"!\[[^]]*\]\(data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)\)", page)
    assert ET.fromstring(base64.b64decode(encoded)).tag.endswith("svg")  # noqa: S314 - our own document
    assert "`file:///store/sheet.svg`" in page


def test_the_page_says_what_could_not_be_made_in_one_line_each():
    failures = {"InvalidInput": {"count": 3, "sample_reason": "six rooms\ndo `not` fit"}}
    last = sheet_markdown(b"<svg/>", "any", failures).rstrip().splitlines()[-1]
    assert last == "3 not made, InvalidInput: `six rooms do 'not' fit`"
