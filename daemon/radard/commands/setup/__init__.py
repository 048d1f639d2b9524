"""`radard setup`: the system's files for the radar, one or all of them, and its coverage."""
