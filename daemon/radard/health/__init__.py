"""Is the daemon well: one state, and the heartbeat, status file and systemd that tell it."""
