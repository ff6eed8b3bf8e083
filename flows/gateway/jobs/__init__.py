"""The calls that start, stop and describe jobs: recorded and queued here, worked off elsewhere. `flows/gateway` joins them."""
