"""`simyard cancel` knows what can be cancelled."""

import pytest

from flows.inspecting import cancel
from specs.errors import DocumentError, ResourceNotFound
from tasks.storage.claim import claimed
from tasks.storage.keys import claim_key
from tasks.storage.store import Store
from tests.simulate.batch_factory import begun


@pytest.mark.parametrize(
    "text", ["arn:simyard:world:0:g/w", "arn:simyard:robot:0:r2", "simb-1", "arn:simyard:planet:0:mars", "nonsense"]
)
def test_what_is_never_cancelled_is_refused(file_store: Store, text: str):
    with pytest.raises(DocumentError, match="arn"):
        cancel(file_store, text)


def test_a_batch_that_does_not_exist_is_not_cancelled(file_store: Store):
    with pytest.raises(ResourceNotFound):
        cancel(file_store, "arn:simyard:simulation-job-batch:0:simb-0")


def test_an_old_arn_of_robomaker_means_the_batch_of_that_name(file_store: Store):
    batch = begun(file_store)
    with claimed(file_store, claim_key("simulation-job-batch", batch.id), ttl_s=0.3):
        cancel(file_store, f"arn:aws:robomaker:us-east-1:111111111111:simulation-job-batch/{batch.id}")
    assert batch.record().status == "Canceling"
