"""Who may do what over HTTP, and who did: access keys, their rights, replays, other pages, the log of actions."""
