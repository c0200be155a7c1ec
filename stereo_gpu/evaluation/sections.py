"""Put generated text into a page that people write: between marks, one pair of them for each section."""

from __future__ import annotations

from collections.abc import Iterable

from stereo_gpu.errors import InputError


def put_section(page: str, name: str, lines: Iterable[str]) -> str:
    """Put lines in the place of what stands between `<!-- NAME: generated -->` and `<!-- NAME: end -->`.

    Raises:
        InputError: the page has no such marks, or has them twice or in the wrong order.
    """
    start, end = f"<!-- {name}: generated -->\n", f"<!-- {name}: end -->\n"
    before, opened, rest = page.partition(start)
    _, closed, after = rest.partition(end)
    if not (opened and closed) or start in rest or end in before + after:
        raise InputError(f"the page must have {start.strip()} and {end.strip()}, once each and in this order")
    return f"{before}{start}\n{chr(10).join(lines)}\n\n{end}{after}"
