"""Worlds in three dimensions and on contact sheets. Flows may import it."""
