"""The calls about jobs: each recorded and queued here, worked off elsewhere. The table of all operations may import it."""
