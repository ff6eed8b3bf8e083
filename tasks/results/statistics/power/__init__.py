"""How many episodes and worlds a rule needs. The gate, plans and flows may import it."""
