"""What commands and Prefect do to a named resource: describe, list, cancel, reap. Flows and the shell may import it."""
