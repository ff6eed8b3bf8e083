"""What an ARN names is found without taking it apart anywhere else."""

import re

import pytest

from specs.arn import (
    KINDS,
    RUN_KIND,
    ArnForm,
    ResourceKind,
    arn,
    parse_reference,
    resource_kind,
    resource_name,
    store_id_of,
)


def test_a_run_has_an_arn_of_its_own():
    text = arn(RUN_KIND, "store", "run-1")
    assert text == "arn:simyard:pipeline-run:store:run-1"
    assert (resource_name(text), store_id_of(text)) == ("run-1", "store")
    assert resource_kind(text) == RUN_KIND


def test_the_kind_and_the_name_of_a_resource():
    job = arn("simulation-job", "store", "simb-1/3")
    assert (resource_kind(job), resource_name(job)) == ("simulation-job", "simb-1/3")
    old = "arn:aws:robomaker:eu-west-1:123456789012:deployment-job/deployment-1"
    assert (resource_kind(old), resource_name(old)) == ("deployment-job", "deployment-1")


@pytest.mark.parametrize("text", ["robot", "arn:aws:iam::1:role/mine"])
def test_what_is_no_arn_of_a_kind_has_none(text: str):
    assert resource_kind(text) is None


FORM = ArnForm("a-store", "eu-west-1")
BATCH, JOB = "simb-0123456789abcdef", "simb-0123456789abcdef/12"
OTHER = "arn:aws:robomaker:us-east-1:123456789012:"


def test_robomakers_form_has_the_region_and_twelve_digits_of_the_store():
    mine = FORM.robomakers(arn("deployment-fleet", "a-store", "aisle"))
    assert re.fullmatch(r"arn:aws:robomaker:eu-west-1:[0-9]{12}:deployment-fleet/aisle", mine)
    assert FORM.account != ArnForm("another", "eu-west-1").account


def test_a_simulation_job_has_one_name_in_robomakers_form():
    before = f"arn:aws:robomaker:eu-west-1:{FORM.account}:"
    assert FORM.robomakers(arn("simulation-job", "a-store", JOB)) == f"{before}simulation-job/sim-0123456789abcdef12"
    assert FORM.robomakers(arn("simulation-job-batch", "a-store", BATCH)) == (
        f"{before}simulation-job-batch/sjb-0123456789abcdef"
    )


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("path", [BATCH, JOB, "wgj-1/2", "guide", "simb-0123456789abcdef/012", "simb-1/3"])
def test_robomakers_form_means_the_same_resource(kind: ResourceKind, path: str):
    own = arn(kind, "a-store", path)
    assert FORM.own(FORM.robomakers(own)) == own


@pytest.mark.parametrize(
    ("text", "path"),
    [
        ("sim-0123456789abcdef12", JOB),
        ("sjb-0123456789abcdef", BATCH),
        (f"{OTHER}simulation-job/sim-0123456789abcdef12", JOB),
        (f"{OTHER}simulation-job-batch/sjb-0123456789abcdef", BATCH),
        (f"{OTHER}deployment-fleet/aisle/1551211803228", "aisle"),
        ("sim-0123456789abcdef", "sim-0123456789abcdef"),
        ("sim-0123456789abcdef01", "sim-0123456789abcdef01"),
    ],
)
def test_robomakers_names_are_understood_everywhere(text: str, path: str):
    assert parse_reference(text).path == path


def test_arns_of_other_regions_accounts_and_stores_become_this_stores():
    mine = arn("robot", "a-store", "r2")
    assert FORM.own(f"{OTHER}robot/r2") == FORM.own(arn("robot", "another", "r2")) == mine


@pytest.mark.parametrize("text", ["arn:aws:iam::1:role/mine", "arn:", "arn:simyard", "arn:simyard:robot", "r2", ""])
def test_what_names_no_resource_stays_as_it_is(text: str):
    assert FORM.own(text) == text
    assert FORM.robomakers(text) == text


def test_arns_in_a_sentence_get_robomakers_form():
    text = f"fleet: '{arn('robot', 'a-store', 'r2')}': no such robot, nor {arn('robot', 'a-store', 'd2')}."
    before = f"arn:aws:robomaker:eu-west-1:{FORM.account}:robot/"
    assert FORM.in_prose(text) == f"fleet: '{before}r2': no such robot, nor {before}d2."
