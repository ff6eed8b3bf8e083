"""How worlds look: surfaces, the GL that draws, cameras on robots. All capabilities may import it."""
