"""The document whose run this is: a context variable, so that no step needs a parameter for the keys of its pages."""

from collections.abc import Generator
from contextlib import contextmanager
from contextvars import ContextVar

from specs import artifact_text

_name: ContextVar[str] = ContextVar("simyard_document", default="")


@contextmanager
def work_for_document(name: str) -> Generator[None, None, None]:
    """Makes everything in the ``with`` block a part of a document's run.

    Args:
        name: The document's; of a stage that runs alone, its flow's.
    """
    token = _name.set(name)
    try:
        yield
    finally:
        _name.reset(token)


def document_name() -> str:
    """Returns the name of the document whose run this is; empty if there is none."""
    return _name.get()


def artifact_key(what: str) -> str:
    """Returns the key of an artifact of this document, such as ``nightly--batch-results``."""
    return artifact_text.artifact_key(_name.get(), what)
