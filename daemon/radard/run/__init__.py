"""The running process: one radar or several, their threads, supervision and reloads."""
