"""`radard setup`: the system's files for the radar, one by one or all of them, and its coverage.

`files` says what each file holds, `system` installs all of them and takes them away again.
"""
