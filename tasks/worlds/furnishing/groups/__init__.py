"""Pieces that stand together, in one frame. Furnishing may import it."""
