"""The evidence of a judgement that was made after a batch's run: kept beside that of the run, and never shipped by.

A rule that is chosen after the numbers were seen can be chosen so that they pass. So this is a form of its own, which
the check before a deployment does not read, and it says by itself what it is (docs/decisions/0014).
"""

import hashlib
from typing import Literal

from specs.base import Spec
from specs.digest import canonical_document, canonical_json
from tasks.results.gate.evidence import Evidence
from tasks.storage.base.keys import result_key
from tasks.storage.base.store import Store

_SENTENCE = "Judged after the batch had ended and its numbers could be seen. It authorises no deployment."
_DIGITS = 16


class LaterEvidence(Spec):
    """What a batch came to under the rules of another document, or of the same one again.

    Attributes:
        notice: What this is, for a person.
        document: SHA-256 of the document whose gate was asked.
        vouched: Whether the owner's key vouches for what the batch's record says.
        judged: What was judged, by which rules, with which answers; it ships nothing.
    """

    kind: Literal["later judgement"] = "later judgement"
    version: Literal["1"] = "1"
    notice: str = _SENTENCE
    document: str
    vouched: bool
    judged: Evidence


class WrittenEvidence(Spec):
    """Where evidence lies, and its SHA-256."""

    url: str
    sha256: str


def write_later_evidence(store: Store, evidence: LaterEvidence) -> WrittenEvidence:
    """Writes the evidence under a name made of its content, so that nothing is ever overwritten by another."""
    body = canonical_json(canonical_document(evidence))
    digest = hashlib.sha256(body).hexdigest()
    key = result_key(evidence.judged.batch, f"later-{digest[:_DIGITS]}.json")
    store.put(key, body)
    return WrittenEvidence(url=f"{store.url}/{key}", sha256=digest)
