"""Prefect's events of assets: what a run has left in the store, and what that was made of.

Prefect's own `@materialize` names its assets before the task runs, and gives each event a new id, so that a run that
was killed and continued would say all twice. Here the keys are URLs of what was made, and ids are made of them: the
server drops what it has (docs/reference/prefect.md, section 9).
"""

import hashlib
import logging
from urllib.parse import urlsplit

import prefect.assets as prefect_assets
from prefect.assets import AssetProperties
from prefect.context import AssetContext
from prefect.events import emit_event
from prefect.types.names import MAX_ASSET_KEY_LENGTH, RESTRICTED_ASSET_CHARACTERS

from flows.run.events import event_id
from flows.stage.assets import Asset, MadeAsset
from specs.digest import canonical_json

MATERIALIZED = "prefect.asset.materialization.succeeded"
REFERENCED = "prefect.asset.referenced"
_MAKER = "simyard"
_PLAIN = str.maketrans(dict.fromkeys(RESTRICTED_ASSET_CHARACTERS, "_"))
_DIGEST_DIGITS = 16
logger = logging.getLogger(__name__)


def announce_asset(made: MadeAsset) -> None:
    """Sends the events of something that was made: one for each of its sources, and one for itself."""
    sources = [_prefect_asset(each) for each in made.sources]
    try:
        own = _prefect_asset(made.asset)
        for source in sources:
            resource = AssetContext.asset_as_resource(source)
            emit_event(REFERENCED, resource, related=[], id=event_id(REFERENCED, f"{source.key}#{own.key}"))
        emit_event(
            MATERIALIZED,
            AssetContext.asset_as_resource(own),
            related=[*map(AssetContext.asset_as_related, sources), AssetContext.related_materialized_by(_MAKER)],
            payload=made.facts,
            # With the figures: a second verdict on a batch is in the same place as the first.
            id=event_id(MATERIALIZED, f"{own.key}#{canonical_json(made.facts).decode()}"),
        )
    except Exception as exc:  # noqa: BLE001 - whatever Prefect's client makes of it, the job goes on
        logger.warning("no event was sent that %s was made: %s", made.asset.name, exc)


def asset_key(url: str) -> str:
    """Returns the key of what is at a URL of a store: the URL, without what Prefect forbids in keys, and secrets.

    A key that is not the URL itself ends in a digest, so that no two URLs have the same key.
    """
    parts = urlsplit(url)
    plain = f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
    key = plain.translate(_PLAIN)
    if key == url and len(key) <= MAX_ASSET_KEY_LENGTH:
        return key
    digest = hashlib.sha256(plain.encode()).hexdigest()[:_DIGEST_DIGITS]
    return f"{key[: MAX_ASSET_KEY_LENGTH - _DIGEST_DIGITS - 1]}-{digest}"


def _prefect_asset(asset: Asset) -> prefect_assets.Asset:
    return prefect_assets.Asset(key=asset_key(asset.url), properties=AssetProperties(name=asset.name))
