"""Reads documents from YAML or JSON and reports all faults at once. Flows may import it."""
