"""The master's thesis that this project starts from, as a recipe that anyone can run again.

Equation, table and section numbers are the thesis'. `cells` holds what it printed, `elements`
draws its data, `mlp` and `fit` are its network and training, `results` and `page` put ours
beside its own, `pictures` draws.
"""
