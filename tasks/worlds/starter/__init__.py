"""A template to begin with, for any rooms. Flows may import it."""
