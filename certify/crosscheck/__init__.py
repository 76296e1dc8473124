"""The simulator as a witness against a certificate: model, equilibrium, storage along motion, attempts to break it.

Nothing here proves anything: it can only find the kernel and the simulator at odds, and then says so loudly.
"""
