"""Skeletons: which parts a kind of body has, how large they are, and how its limbs bend."""
