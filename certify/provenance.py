"""What a certificate says of itself and nobody has proved: when it was made."""

from __future__ import annotations

import os
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from certify.kernel.errors import Fault, SpecError

EPOCH = "SOURCE_DATE_EPOCH"
TIME_FORMAT = "%Y-%m-%dT%H:%M:%SZ"


def moment(stamp: bool = False) -> str | None:
    """The time for a certificate to carry: SOURCE_DATE_EPOCH if that is set, the clock if asked to `stamp`, else none.

    None is the default, so that the same spec gives the same bytes again. Raises: SpecError U001 as `settle_epoch`.
    """
    settle_epoch()
    if epoch := os.environ.get(EPOCH):
        return datetime.fromtimestamp(int(epoch), UTC).strftime(TIME_FORMAT)
    return datetime.now(UTC).strftime(TIME_FORMAT) if stamp else None


def settle_epoch() -> None:
    """Take an empty SOURCE_DATE_EPOCH for none. Raises: SpecError U001 for one that is no time.

    A part of numpy that scipy imports reads it as a number too, and its failure would pass for that of a search.
    """
    epoch = os.environ.get(EPOCH, "0")
    if not epoch:
        del os.environ[EPOCH]
    elif not (epoch.isascii() and epoch.isdecimal() and len(epoch) < 12):  # up to the year 5138
        message = f"seconds since 1970 are expected in it, such as 1700000000, not {ascii(epoch)[:60]}"
        raise SpecError((Fault("U001", EPOCH, message),))


def read_created(document: Mapping[str, Any]) -> str | None:
    """When a certificate says that it was made, whatever it says; None if it does not."""
    provenance = document["provenance"]
    created = provenance.get("created") if isinstance(provenance, dict) else None
    return created if isinstance(created, str) else None
