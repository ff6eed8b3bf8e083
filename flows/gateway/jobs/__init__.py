"""The calls about jobs: recorded and queued here, worked off elsewhere. The table of all operations may import it."""
