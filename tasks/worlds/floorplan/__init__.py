"""A floor plan: slicing, search, refinement, passages, walls, doors, windows.

Furnishing and the certificate may import it.
"""
