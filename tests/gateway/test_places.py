import pytest

from tasks.gateway.rest_json import without_places

STORE = "file:///srv/secret place/store"


@pytest.mark.parametrize("place", [f"the store {STORE}", STORE, "/srv/secret place/store", "file:///else/bucket"])
def test_a_text_names_the_store_and_not_where_it_lies(place: str):
    assert without_places(f"{place}; no such bucket", STORE) == "the store; no such bucket"


def test_a_text_without_a_place_stays():
    text = "the robot fell over: /opt/app/run.sh, s3://results"
    assert without_places(text, STORE) == text
