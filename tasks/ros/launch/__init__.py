"""What a launch file starts: packages, nodes, parameters, environment. Process and lockstep may import it."""
