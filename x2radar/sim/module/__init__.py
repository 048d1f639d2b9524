"""The far end of the wire: a simulated module with its firmware, its line and its faults.

It may import all of `x2radar.sim`; nothing there imports it.
"""
