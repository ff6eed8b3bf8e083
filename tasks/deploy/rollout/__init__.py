"""Deployment jobs: a version rolled out in waves. Answers and flows may import it."""
