"""Composition only: the flows that join the capabilities, and the command line."""
