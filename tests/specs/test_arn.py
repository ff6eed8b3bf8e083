"""What an ARN names is found without taking it apart anywhere else."""

import pytest

from specs.arn import RUN_KIND, arn, resource_kind, resource_name, store_id_of


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
