"""The pages that a browser is shown: what is read from the store, and who may see it. The gateway imports it."""
