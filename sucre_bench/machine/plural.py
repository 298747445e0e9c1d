"""Numbers with their nouns, in the singular or plural."""


def counted(number: int, name: str) -> str:
    """Return a number with its name: "1 table", "2 tables"."""
    return f"{number} {name}{'' if number == 1 else 's'}"
