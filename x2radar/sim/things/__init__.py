"""Things that move and must not alarm, and the mount that shakes the antenna."""
