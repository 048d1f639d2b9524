"""All sinks of a process together, and the records of the JSON Lines contract that they get.

It may import `radard.sinks` and below.
"""
