"""Worlds become files that other programs open."""
