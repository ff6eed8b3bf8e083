"""A Prefect server as a child process: started, waited for, ended, or kept."""
