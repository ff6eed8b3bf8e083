"""What commands do to a named resource: describe, list, cancel. Flows and the shell may import it."""
