"""A batch before and after its simulation: early end, report, replay, shrink, compare.

Flows and the shell may import it.
"""
