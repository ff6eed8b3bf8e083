"""The furniture types, each one record in the file of its family. Furnishing may import it."""
