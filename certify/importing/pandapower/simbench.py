"""SimBench grids, by their code or from a file: networks of pandapower with load profiles, which are not read."""

from __future__ import annotations

import os
import warnings
from typing import Any

from certify.importing.network import Network
from certify.importing.pandapower import from_net
from certify.importing.pandapower.file import file_name, import_pandapower, load_net
from certify.importing.settings import Placement
from certify.kernel.errors import Fault, SpecError
from certify.kernel.quantity import shorten


def from_code(code: str, placement: Placement) -> Network:
    """The network of a code, or of a file if there is one of this name. Raises: SpecError I008, I010, as the others."""
    if os.path.exists(code) or code.endswith(".json"):
        return from_net(load_net(code), f"{file_name(code)}, a SimBench grid as a file of pandapower", placement)
    return from_net(load_grid(code), f"the SimBench grid {shorten(code)[1:-1]}", placement)


def load_grid(code: str) -> Any:
    """The pandapowerNet of a code, from the data that the package simbench ships. Raises: SpecError I008, I010."""
    import_pandapower()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of simbench and pandas about each other
        try:
            import simbench
        except ImportError as error:
            text = f"simbench is not there ({error}): pip install 'certify-eip[simbench]' (380 MB, most of it data)"
            raise SpecError((Fault("I008", "", text),)) from None
        if code not in simbench.collect_all_simbench_codes():
            raise SpecError((Fault("I010", "", f"{shorten(code)} is neither a file nor the code of a SimBench grid"),))
        return simbench.get_simbench_net(code)
