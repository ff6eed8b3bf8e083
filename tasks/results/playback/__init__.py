"""One episode as animation, film and MCAP. Compare and flows may import it."""
