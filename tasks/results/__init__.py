"""Result tables, statistics, the gate and its evidence. Flows may import it."""
