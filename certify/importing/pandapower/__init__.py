"""Networks of pandapower, and SimBench grids through it.

`file` says what of a file pandapower gets to see, `rows` reads the cells of its tables with a fault for each that is
not usable, `loads`, `branches` and `generating` make parts of a network of them, `read` puts these together, and
`simbench` finds a grid by its code.
"""

from certify.importing.pandapower.read import from_net

__all__ = ["from_net"]
