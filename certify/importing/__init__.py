"""Networks of other programs as specs: a format is read into a `Network`, and `to_spec` writes that as TOML.

What every format needs is here and knows none of them: islands, transformers referred to one side, capacitances,
controllers for inverters, names, and the text itself. A format is one more package that makes a `Network`.
"""

from certify.importing.draft import Draft, to_spec
from certify.importing.network import Branch, Bus, ExpRow, Network, Note, Source, Unmapped, ZipRow
from certify.importing.settings import Placement, Settings

__all__ = [
    "Branch",
    "Bus",
    "Draft",
    "ExpRow",
    "Network",
    "Note",
    "Placement",
    "Settings",
    "Source",
    "Unmapped",
    "ZipRow",
    "to_spec",
]
