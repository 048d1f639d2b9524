"""How the parts of a body echo: cross sections of segments and their slow fluctuation.

It imports no other room of the bodies.
"""
