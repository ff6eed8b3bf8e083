"""The document whose run this is gives the keys of its artifacts."""

from tasks.progress.listener import artifact_key, document_name, work_for_document


def test_a_key_has_the_name_of_the_document_inside_the_block_only():
    with work_for_document("nightly"):
        assert (document_name(), artifact_key("gate")) == ("nightly", "nightly--gate")
    assert (document_name(), artifact_key("gate")) == ("", "gate")


def test_a_run_in_a_run_has_its_own_name():
    with work_for_document("nightly"):
        with work_for_document("weekly"):
            assert artifact_key("gate") == "weekly--gate"
        assert artifact_key("gate") == "nightly--gate"
