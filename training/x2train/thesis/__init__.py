"""The master's thesis that this project starts from, as a recipe that anyone can run again.

Equation, table and section numbers are the thesis'. `elements` draws its data, `fit` is its
network and training, `recipe` keeps results, `page` puts them beside its own, `pictures` draws.
"""
