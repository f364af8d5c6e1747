"""Numbers that a user gives."""

import math

from relight.core.errors import UserError


def finite(what: str, value: object, least: float = -math.inf, most: float = math.inf) -> float:
    """Returns a number, which may be typed as text.

    Args:
        what: names it in the error.
        value: to read.
        least, most: inclusive bounds; both, or none.

    Raises:
        UserError: if it is no finite number, or out of bounds.

    >>> finite("turn", "90", -360, 360)
    90.0
    """
    try:
        number = float(value)  # type: ignore[arg-type]
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if math.isfinite(number) and least <= number <= most:
        return number
    bounds = f" from {least:g} to {most:g}" if math.isfinite(least) else ""
    raise UserError(f"{what} is {value!r}: it must be a finite number{bounds}")
