"""What is simulated: families of bodies, sites, passages, windows, and sets of them on disk."""
