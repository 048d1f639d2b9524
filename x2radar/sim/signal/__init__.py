"""What a receiver makes of echoes: the pulse, its noise, the converter and its imperfections.

It may import `x2radar.keys` and `points`, and knows no scene, no body and no protocol.
"""
