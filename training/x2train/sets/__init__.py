"""What is simulated: families of bodies, sites, passages, domain randomization.

It imports the driver alone.
"""
