"""The process that applications run in, seen from outside: started, confined, asked, timed, ended."""
