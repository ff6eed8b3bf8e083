"""A batch as a job: chunks committed one by one, cancelled, restarted, described.

Audit, replay and flows may import it.
"""
