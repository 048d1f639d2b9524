"""Where a body goes and when its feet stand: courses, timetables, strides, footfalls.

It imports no other room of the bodies.
"""
