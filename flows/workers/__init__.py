"""Work handed to Dask and Ray workers. Flows may import it."""
