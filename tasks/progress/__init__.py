"""Progress of a stage, told to whoever watches: the terminal and Prefect."""
