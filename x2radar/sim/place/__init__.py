"""Where the radar hangs: its antennas, what stands still around it, and indirect paths.

It may import `x2radar.sim.signal`, `points` and `keys`.
"""
