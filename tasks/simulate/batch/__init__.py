"""A batch as a job: chunks committed, cancelled, restarted, described, listed. Audit, replay, flows may import it."""
