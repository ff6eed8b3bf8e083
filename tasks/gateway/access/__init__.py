"""Who may do what over HTTP, and who did: access keys, rights, replays, other pages, the log. The gateway imports it."""
