"""Who may sign in to the page of a browser, and what each may see: those whose keys may read, within their limits."""

from tasks.gateway.access.key_file import KeyFile
from tasks.gateway.access.rights import FleetOf, covers_arn


class PageReaders:
    """The keys of a file as readers; several threads may ask.

    Args:
        keys: Those that are in force now.
        store_id: Of the store that is shown.
        fleet_of: Says which fleet something belongs to.
    """

    def __init__(self, keys: KeyFile, store_id: str, fleet_of: FleetOf) -> None:
        self._keys, self._store_id, self._fleet_of = keys, store_id, fleet_of

    def secret_of(self, key_id: str) -> str | None:
        """Returns the secret of a key that may read; None for every other."""
        key = self._keys.key(key_id)
        return key.secret if key and "read" in key.rights else None

    def may_read(self, key_id: str, arn: str) -> bool:
        """Returns whether a key may see the resource of an ARN."""
        key = self._keys.key(key_id)
        return key is not None and "read" in key.rights and covers_arn(key, arn, self._store_id, self._fleet_of)
