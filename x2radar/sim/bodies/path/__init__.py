"""Where a body goes and when its feet stand: courses, timetables, strides, footfalls."""
