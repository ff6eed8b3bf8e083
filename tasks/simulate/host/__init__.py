"""Controllers that run on the host, between two control steps of all lanes. Engines may import it."""
