"""Entries: a method each, in one small file with its source.

An entry is a function ``scores(train, test, seed)``: it takes two `Elements`, may look at
everything in `train` and at all but `is_person` and `in_view` of `test`, and returns the
probability of a person for every element of `test`, shape (n,), 0 to 1. One with USES_VECTOR
False gets no vectors, and runs once for tasks that differ in them alone. An alarm is a function
``alarms(windows)`` instead, see `x2train.judge.alarm_function`.
"""
