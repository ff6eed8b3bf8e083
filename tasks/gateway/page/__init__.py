"""The page of a browser: what stands on it, how it looks, and who may see it. Only flows import it."""
