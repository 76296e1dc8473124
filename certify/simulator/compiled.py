"""Compiled inner loops where numba is installed; the same code, uncompiled, where it is not."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

Function = TypeVar("Function", bound=Callable[..., Any])

try:
    if os.environ.get("CERTIFY_NUMBA") == "0":
        raise ImportError
    from numba import njit

    COMPILED = True
except ImportError:
    COMPILED = False


def compiled(function: Function) -> Function:
    """The function, compiled on first use if numba is there and CERTIFY_NUMBA is not 0; kept between runs."""
    if not COMPILED:
        return function
    made: Function = njit(cache=True, error_model="numpy")(function)
    return made
