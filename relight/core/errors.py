"""Errors that a user can cause, and their one sentence."""


class UserError(Exception):
    """An error that a user can cause and correct: one sentence that names what is wrong and what would be right."""


def out_of_memory(error: MemoryError) -> str:
    """Returns the message for a user whose machine has too little memory."""
    requested = str(error).strip().split("\n")[0]
    detail = f" ({requested})" if requested else ""
    return f"there is not enough memory{detail}: take a smaller size, or run fewer jobs at once"
