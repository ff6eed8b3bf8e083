"""Worlds as files that other programs open. Flows may import it."""
