"""RoboMaker's operations, and how many of what an account may have."""

import pytest

from specs.errors import DocumentError
from specs.robomaker import operations
from specs.robomaker.operations import OPERATIONS, STATUSES, document_shapes
from specs.settings import CountSetting
from tests.specs.contract_forms import contract, models


def test_the_operations_are_those_of_the_contract():
    stated = contract()["operations"]

    assert OPERATIONS.keys() == stated.keys()
    for name, operation in OPERATIONS.items():
        known = stated[name]
        assert (operation.method, operation.path) == (known["method"], known["path"])
        assert (operation.request, operation.answer) == (known["input"], known["output"])
        assert operation.idempotent == bool(known["idempotencyTokenField"])
        assert operation.pages == known.get("pagination", {}).get("result_key", "")
        errors = {f"{error}Exception": STATUSES.get(error, 400) for error in operation.errors}
        assert errors == {error["shape"]: error["httpStatus"] for error in known["errors"]}


def test_every_document_class_is_found_by_its_name():
    assert document_shapes() == models()


QUOTAS = [each for each in vars(operations).values() if isinstance(each, CountSetting)]


@pytest.mark.parametrize("quota", QUOTAS, ids=lambda quota: quota.variable)
def test_a_quota_is_what_its_variable_says(quota: CountSetting, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv(quota.variable, raising=False)
    assert quota.value() == quota.default
    monkeypatch.setenv(quota.variable, "3")
    assert quota.value() == 3
    monkeypatch.setenv(quota.variable, "none")
    with pytest.raises(DocumentError, match=quota.variable):
        quota.value()
