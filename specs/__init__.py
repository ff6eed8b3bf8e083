"""The declarative language: frozen documents with RoboMaker's words, and the errors. Anyone may import it."""
