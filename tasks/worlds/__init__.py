"""A WorldForge template becomes certified apartments. Flows may import it."""
