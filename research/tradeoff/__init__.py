"""The trade-off of speed and accuracy: what every method and bundle costs, and loses."""
