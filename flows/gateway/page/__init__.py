"""Pages of a browser: what is read from the store for each, and who may see it. Only flows.gateway imports it."""
