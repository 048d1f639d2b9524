"""From a trained network to the files that the daemon loads, and the shipped ones' recipes."""
