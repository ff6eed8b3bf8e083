"""Every kind of resource, and every kind of job, is known to the commands."""

from typing import get_args

from typer.testing import CliRunner

from flows.cli.shell import app
from flows.resources.kinds import KINDS
from specs.arn import ResourceKind
from specs.job_kinds import JOB_KINDS, JobKind
from tasks.storage.base.store import Store


def test_every_kind_of_resource_has_its_commands() -> None:
    assert set(KINDS) == set(get_args(ResourceKind))


def test_every_kind_of_job_is_declared_once_and_can_be_cancelled() -> None:
    assert tuple(JOB_KINDS) == get_args(JobKind)
    assert all(KINDS[kind].load().cancel for kind in JOB_KINDS)
    prefixes = [declared.prefix for declared in JOB_KINDS.values()]
    assert len(set(prefixes)) == len(prefixes)


def test_a_waiting_process_is_told_how_far_each_stage_is() -> None:
    assert all(KINDS[kind].load().progress for kind, declared in JOB_KINDS.items() if declared.stage)


def test_the_help_names_every_kind_and_each_can_be_listed(file_store: Store) -> None:
    said = CliRunner().invoke(app, ["list", "--help"], terminal_width=1000).output
    for kind in KINDS.values():
        assert kind.plural in said
        assert list(kind.load().list(file_store)) == []
