"""Documents are read from YAML or JSON, and every fault is reported at once."""
