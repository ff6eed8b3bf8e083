"""Robot and simulation application bundles: digests, numbered versions, unpacking."""
