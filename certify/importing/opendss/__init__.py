"""Circuits of OpenDSS as networks: scripts are understood by its own engine, and elements compared with what it makes
of them.

`commands` and `script` say what of a script the engine gets to see, `engine` runs it in a process of its own,
`circuit` and `elements` read the answer, `loads`, `branches` and `generating` make parts of a network of it, and
`read` puts these together.
"""

from certify.importing.opendss.read import read_network

__all__ = ["read_network"]
