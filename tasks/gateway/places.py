"""Texts for clients: they say "the store" where a message has the place of the store, or of a bucket beside it."""

import re

_URL = re.compile(r"file://[^\s'\";,)]*")


def without_places(text: str, store_url: str) -> str:
    """Returns a text without the places of a store and of folders on this machine.

    Args:
        text: A message, or the reason of a failure.
        store_url: Of the store that is served.
    """
    for place in (f"the store {store_url}", store_url, store_url.removeprefix("file://")):
        text = text.replace(place, "the store")
    return _URL.sub("the store", text)
