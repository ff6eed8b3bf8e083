"""Who may do what over HTTP, and who did: access keys, rights, replays, other pages, log. The gateway imports it."""
