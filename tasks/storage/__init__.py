"""Objects in a folder or on S3: atomic writes, buckets, job records, claims. Any task and flow may import it."""
