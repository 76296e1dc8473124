"""Specs built and edited in Python."""

from certify.building.spec import Spec

__all__ = ["Spec"]
