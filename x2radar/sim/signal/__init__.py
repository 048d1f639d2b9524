"""What a receiver makes of echoes: the pulse, its noise, the converter and its imperfections."""
