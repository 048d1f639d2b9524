"""The running process: one radar or several, their threads, supervision and reloads.

It may import everything but `radard.web` and `radard.commands`.
"""
