"""What each kind of module is told before it streams, and the commands that tell it."""
