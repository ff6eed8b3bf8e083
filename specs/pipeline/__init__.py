"""The pipeline document, a module for each kind of section. Anyone may import it."""
