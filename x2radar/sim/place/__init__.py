"""Where the radar hangs: its antennas, what stands still around it, and indirect paths."""
