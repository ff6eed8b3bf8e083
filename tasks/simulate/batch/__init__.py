"""A batch as a job: chunks committed, cancelled, restarted, described. Audit, replay and flows may import it."""
