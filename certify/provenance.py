"""What a certificate says of itself and nobody has proved: when it was made."""

from __future__ import annotations

import os
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

TIME_FORMAT = "%Y-%m-%dT%H:%M:%SZ"


def moment(stamp: bool = False) -> str | None:
    """The time for a certificate to carry: SOURCE_DATE_EPOCH if that is set, the clock if asked to `stamp`, else none.

    None is the default, so that the same spec gives the same bytes again.
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    if epoch.isascii() and epoch.isdecimal() and len(epoch) < 12:  # up to the year 5138
        return datetime.fromtimestamp(int(epoch), UTC).strftime(TIME_FORMAT)
    return datetime.now(UTC).strftime(TIME_FORMAT) if stamp else None


def read_created(document: Mapping[str, Any]) -> str | None:
    """When a certificate says that it was made, whatever it says; None if it does not."""
    provenance = document["provenance"]
    created = provenance.get("created") if isinstance(provenance, dict) else None
    return created if isinstance(created, str) else None
