"""A floor plan: slicing, search, refinement, passages, walls, doors, windows. Furnishing and above may import it."""
