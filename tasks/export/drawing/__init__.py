"""The floor plan as a drawing (SVG). Pictures, formats and flows may import it."""
