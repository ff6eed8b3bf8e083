"""The pages that a browser is shown: what is read from the store for each, and who may see it."""
