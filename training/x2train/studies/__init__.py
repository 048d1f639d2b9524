"""Studies that make pages for docs: the thesis, recorded walks, the trade-off. Not in the wheel.

They may import all of x2train but `x2train.commands`; nothing else imports them.
"""
