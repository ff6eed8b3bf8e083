import pytest

from tasks.applications.registry import pack, shipped_application


@pytest.mark.parametrize("name", ["courier", "delivery"])
def test_the_applications_that_ship_with_simyard_are_found_and_can_be_packed(name: str) -> None:
    folder = shipped_application(name)

    assert folder is not None
    assert pack(folder)


@pytest.mark.parametrize("name", ["nothing", "..", "../applications/courier", "", "courier/courier"])
def test_no_other_name_leads_anywhere(name: str) -> None:
    assert shipped_application(name) is None
