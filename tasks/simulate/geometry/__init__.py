"""A world as a robot meets it: obstacles, lidar, floor map, shortest paths. Lanes and engines may import it."""
