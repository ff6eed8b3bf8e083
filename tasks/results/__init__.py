"""Parquet tables, statistics, the gate and its evidence."""
