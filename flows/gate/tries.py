"""Counts how often a gate was asked before of the same version on other episodes, without a PASS.

Who runs a document again with other seeds until it passes gets a false PASS more often than its confidence says. So
each run that does not pass leaves a name in the store, in a folder of the document's name, its gate and the bundles
that were tested. One listing counts them; no record is opened. The same episodes judged again are the same try.

Whoever may write to the store can remove such names. They decide nothing: they are what the sentence says.
"""

import hashlib
from collections.abc import Callable

from pydantic import JsonValue

from flows.document.tested_batch import candidates
from flows.gate.equal_worlds import world_identities
from specs.digest import canonical_document, canonical_json, digest
from specs.pipeline.gate_section import Gate
from tasks.simulate.batch.job import plan_of
from tasks.simulate.plan.batch_plan import BatchPlan
from tasks.storage.base.key_rules import key_pattern
from tasks.storage.base.keys import TRY, tries_prefix, try_key
from tasks.storage.base.store import Store
from tasks.storage.jobs.records import JobRecord
from tasks.storage.jobs.runs import run_document

_DIGITS = 32
# What decides neither which episodes a batch has nor what comes of them.
_WORK = frozenset({"lanes", "timeout_s", "recordings", "audit", "shuffled", "worlds", "world_digests"})


def ledger_of(run: JobRecord, gate: Gate, batch: JobRecord, compared_with: str) -> str:
    """Returns what the tries of a run are counted under: its document's name, its gate, and the tested bundles.

    Args:
        run: The run.
        gate: What its document asks for.
        batch: The judged batch.
        compared_with: SHA-256 of the bundle that the gate compares with, or empty.
    """
    tested = candidates(plan_of(batch), compared_with)
    asked: dict[str, JsonValue] = {
        "document": run_document(run),
        "gate": canonical_document(gate),
        "tested": [*sorted(tested)],
    }
    return hashlib.sha256(canonical_json(asked)).hexdigest()[:_DIGITS]


def tries_before(store: Store, ledger: str, episodes: Callable[[], str]) -> int:
    """Returns how many other batches were judged under a ledger without a PASS.

    Args:
        store: Where the ledger is.
        ledger: Its name.
        episodes: Gives the name of this batch's episodes; not asked where there is no other try.
    """
    form = key_pattern(TRY, ledger=ledger)
    matches = (form.fullmatch(key) for key in store.keys(tries_prefix(ledger)))
    known = {found["episodes"] for found in matches if found}
    return len(known - {episodes()}) if known else 0


def note_try(store: Store, ledger: str, episodes: str, batch: str) -> None:
    """Leaves the name of a batch's episodes under a ledger; doing it again changes nothing."""
    store.put(try_key(ledger, episodes), canonical_json({"batch": batch}))


def episodes_name(store: Store, plan: BatchPlan) -> str:
    """Returns a name for a batch's episodes: equal worlds, seeds, variables, scenarios and bundles have the same one.

    Worlds that were generated again are the same ones. How the batch was cut into chunks makes no difference.
    """
    identities = world_identities(store, plan.worlds_used())
    asked = canonical_document(plan.model_copy(update={"templates": ()}))
    known = {name: value for name, value in asked.items() if name not in _WORK}
    templates: list[JsonValue] = [
        {
            "request": digest(template.model_copy(update={"worlds": (), "record": False})),
            "worlds": [*sorted(identities[world] for world in plan.worlds_of(template))],
        }
        for template in plan.templates
    ]
    body = canonical_json({**known, "templates": [*sorted(templates, key=str)]})
    return hashlib.sha256(body).hexdigest()[:_DIGITS]
