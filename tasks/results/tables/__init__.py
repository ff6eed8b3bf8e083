"""A batch's Parquet files, written and read. Gate, compare, playback and report may import it."""
