"""Objects under one fsspec root: atomic creation, compare-and-swap, buckets, job records, claims."""
