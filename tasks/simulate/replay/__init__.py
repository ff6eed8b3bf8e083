"""An episode simulated once more, and made smaller. Flows may import it."""
