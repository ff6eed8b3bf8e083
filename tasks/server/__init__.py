"""A Prefect server as a child process: start, wait, end or keep. Capabilities and flows may import it."""
