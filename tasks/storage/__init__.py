"""Objects under one root: atomic creation, compare-and-swap, buckets, job records, claims."""
