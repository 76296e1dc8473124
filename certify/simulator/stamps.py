"""Sparse matrices that are put together from small blocks."""

from __future__ import annotations

from typing import Any

import numpy
from scipy.sparse import csr_matrix


class Stamps:
    """A sparse matrix to which blocks are added, at slices or at scattered places; where they meet they add up."""

    def __init__(self, rows: int, columns: int) -> None:
        self.shape = (rows, columns)
        self._rows: list[Any] = []
        self._columns: list[Any] = []
        self._values: list[Any] = []

    def add(self, rows: Any, columns: Any, block: Any) -> None:
        rows, columns = _places(rows), _places(columns)
        self._rows.append(numpy.repeat(rows, len(columns)))
        self._columns.append(numpy.tile(columns, len(rows)))
        self._values.append(block.reshape(-1))

    def matrix(self) -> csr_matrix:
        if not self._values:
            return csr_matrix(self.shape)
        where = (numpy.concatenate(self._rows), numpy.concatenate(self._columns))
        result = csr_matrix((numpy.concatenate(self._values), where), shape=self.shape)
        result.eliminate_zeros()
        return result


def _places(at: Any) -> Any:
    return numpy.arange(at.start, at.stop) if isinstance(at, slice) else at
