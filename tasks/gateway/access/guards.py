"""Who gets in: with signatures, or without them on this machine's own address."""

import logging
import time
from collections.abc import Callable, Collection

from specs.arn import parse_reference
from specs.base import Spec
from specs.errors import AccessRefused, DocumentError
from specs.interface.operations import Operation
from tasks.gateway.access.access_key import AccessKey
from tasks.gateway.access.key_file import KeyFile
from tasks.gateway.access.page_origin import refuse_other_pages
from tasks.gateway.access.replay import UsedSignatures
from tasks.gateway.access.rights import FleetOf, check_right, is_within
from tasks.gateway.door import Caller
from tasks.gateway.error_answers import error_answer
from tasks.gateway.messages import HttpAnswer, HttpRequest
from tasks.gateway.signature import check_signature, claim_of, unknown_key

_LOG = logging.getLogger(__name__)
_KEYS_AWAY = "the access keys cannot be read; the log of simyard serve says more"


class SignedGuard:
    """Lets in who signs with a key of the file, for what that key may do.

    Args:
        keys: Those that are in force now.
        store_id: Of the store that is served.
        fleet_of: Says which fleet something belongs to.
    """

    def __init__(self, keys: KeyFile, store_id: str, fleet_of: FleetOf) -> None:
        self._keys, self._store_id, self._fleet_of = keys, store_id, fleet_of
        self._used = UsedSignatures()

    def refuse_head(self, request: HttpRequest, operation: Operation | None) -> HttpAnswer | None:
        """Returns the refusal if the head alone says that the request will not be let in: no body is read for it."""
        return _refusal(lambda: self._check_head(request, operation))

    def admit(self, request: HttpRequest, operation: Operation | None) -> Caller | HttpAnswer:
        """Returns whose key signed a request; a page of the browser says itself who may see it."""
        found = Caller()

        def check() -> None:
            nonlocal found
            found = self._signer(request, operation)

        return _refusal(check) or found

    def permit(self, caller: Caller, operation: Operation, document: Spec) -> HttpAnswer | None:
        """Returns the refusal if the key may not do it."""
        return _refusal(
            lambda: check_right(self._known(caller.key), operation, document, self._store_id, self._fleet_of)
        )

    def secret_of(self, key_id: str) -> str | None:
        """Returns the secret of a key that may read, for who signs in on the page; None for every other."""
        key = self._reader(key_id)
        return key.secret if key else None

    def may_read(self, key_id: str, arn: str) -> bool:
        """Returns whether a key may see a resource of the store on the page."""
        key, named = self._reader(key_id), parse_reference(arn)
        if key is None or named.kind is None:
            return False
        return is_within(key, named.kind, named.path, self._store_id, self._fleet_of)

    def _reader(self, key_id: str) -> AccessKey | None:
        try:
            key = self._keys.key(key_id)
        except DocumentError as exc:
            _LOG.error("%s", exc)
            return None
        return key if key and "read" in key.rights else None

    def _check_head(self, request: HttpRequest, operation: Operation | None) -> None:
        refuse_other_pages(request, operation=operation is not None)
        if operation is not None:
            self._known(claim_of(request, time.time()).key_id)

    def _signer(self, request: HttpRequest, operation: Operation | None) -> Caller:
        refuse_other_pages(request, operation=operation is not None)
        if operation is None:
            return Caller()
        claim = claim_of(request, time.time())
        key = self._known(claim.key_id)
        check_signature(request, claim, key.secret)
        if operation.right != "read":
            self._used.use(claim.signature, time.monotonic())
        return Caller(key.key_id, key.name)

    def _known(self, key_id: str) -> AccessKey:
        key = self._keys.key(key_id)
        if key is None:
            raise unknown_key(key_id)
        return key


class LoopbackGuard:
    """Lets in every program that reaches this machine's own address, and no page of another site.

    Args:
        hosts: The names with ports that this server has.
    """

    def __init__(self, hosts: Collection[str]) -> None:
        self._hosts = hosts

    def refuse_head(self, request: HttpRequest, operation: Operation | None) -> HttpAnswer | None:
        """Returns the refusal of another name for this machine, and of a page of another site."""
        return _refusal(lambda: refuse_other_pages(request, operation=operation is not None, hosts=self._hosts))

    def admit(self, request: HttpRequest, operation: Operation | None) -> Caller | HttpAnswer:
        """Returns the nameless caller, or the refusal."""
        return self.refuse_head(request, operation) or Caller()

    def permit(self, caller: Caller, operation: Operation, document: Spec) -> HttpAnswer | None:  # noqa: ARG002
        """Allows everything."""
        return None


def _refusal(check: Callable[[], None]) -> HttpAnswer | None:
    try:
        check()
    except AccessRefused as exc:
        return error_answer(exc.status, exc.code, str(exc))
    except DocumentError as exc:
        _LOG.error("%s", exc)
        return error_answer(500, "InternalServerException", _KEYS_AWAY)
    return None
