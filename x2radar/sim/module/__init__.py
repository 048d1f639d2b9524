"""The far end of the wire: a simulated module with its firmware, its line and its faults."""
