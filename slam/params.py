"""What every parameter class has in common: frozen, and strict about names and ranges.

Numbers are finite unless a field says otherwise.
"""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Params(BaseModel):
    """Parameters of one algorithm; a misspelt key or a value out of range is an error that names it."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", populate_by_name=True, allow_inf_nan=False, ser_json_inf_nan="strings"
    )
