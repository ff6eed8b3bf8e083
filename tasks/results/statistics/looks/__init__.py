"""Tests of a share that may be looked at before the last episode. The gate and flows may import it."""
