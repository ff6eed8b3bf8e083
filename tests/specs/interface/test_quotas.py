"""Quotas: how much there may be."""

import pytest

from specs.errors import DocumentError
from specs.robomaker import operations
from specs.robomaker.operations import Quota

QUOTAS = [each for each in vars(operations).values() if isinstance(each, Quota)]


@pytest.mark.parametrize("quota", QUOTAS, ids=lambda quota: quota.setting)
def test_a_quota_is_what_its_variable_says(quota: Quota, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv(quota.setting, raising=False)
    assert quota.most() == quota.default
    monkeypatch.setenv(quota.setting, "3")
    assert quota.most() == 3
    monkeypatch.setenv(quota.setting, "none")
    with pytest.raises(DocumentError, match=quota.setting):
        quota.most()
