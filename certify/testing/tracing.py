"""Proofs without a tracer: hypothesis, to explain a failure, follows every line that runs while it shrinks.

Which lines of a proof run says nothing about the test, and following them makes a proof ten times as long. Other
tracers, of debuggers and coverage, stay.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager

_EXPLAINS = "hypothesis.internal.scrutineer"


@contextmanager
def unexplained() -> Iterator[None]:
    """Within the block hypothesis follows no lines."""
    trace = sys.gettrace()
    owner = getattr(trace, "__self__", None)
    if owner is None or type(owner).__module__ != _EXPLAINS:
        yield
        return
    sys.settrace(None)
    try:
        yield
    finally:
        sys.settrace(trace)
