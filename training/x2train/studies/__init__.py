"""Studies that make pages for docs: the thesis, recorded walks, the trade-off. Not in the wheel.

Each folder's `command.py` is a command of `train-export`, which finds them where they are. They
may import all of x2train; nothing imports them.
"""
