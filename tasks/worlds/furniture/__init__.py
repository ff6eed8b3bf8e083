"""The furniture types: size, shape, place. Furnishing may import it."""
