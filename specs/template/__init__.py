"""WorldForge template bodies, versions 1 and 2. Anyone may import it."""
