"""An agent that looks into the wrong store says so at once."""

import logging

import pytest

from tasks.deploy.fleet.fleet_registry import create_robot
from tasks.deploy.robot.agent import _warn_if_unknown
from tasks.storage.base.store import Store


def test_a_robot_that_the_store_does_not_have_is_told_with_the_store(
    file_store: Store, caplog: pytest.LogCaptureFixture
):
    _warn_if_unknown(file_store, "r1")
    assert f"no robot r1 in the store {file_store.url}" in caplog.text


def test_a_registered_robot_needs_no_warning(file_store: Store, caplog: pytest.LogCaptureFixture):
    create_robot(file_store, "r1")
    with caplog.at_level(logging.INFO):
        _warn_if_unknown(file_store, "r1")
    assert not caplog.text
