"""Numbers of things in words."""


def counted(number: int, what: str) -> str:
    """Such as "1 pair" and "1,000 pairs"."""
    return f"{number:,} {what}{'' if number == 1 else 's'}"
