"""Networks in torch and how they are trained: maps, temporal head, teachers, graphs.

It may import `x2train.sets` and below.
"""
