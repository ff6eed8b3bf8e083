"""An application's processes: started, watched, ended. Lockstep may import it."""
