"""Generated parts of a text file, each between <!-- NAME --> and <!-- /NAME -->."""

from pathlib import Path


def fill(path: Path, parts: dict[str, str]) -> None:
    """Put each text between the marks of its name.

    Raises ValueError if a mark is missing or occurs more than once.
    """
    text = path.read_text()
    for name, part in parts.items():
        begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
        if text.count(begin) != 1 or text.count(end) != 1:
            raise ValueError(f"{path}: expected the marks {begin} and {end} once each")
        head, rest = text.split(begin)
        text = f"{head}{begin}{part}{end}{rest.split(end)[1]}"
    path.write_text(text)


def block(part: str) -> str:
    """A part that is a separate paragraph or table, with blank lines around it."""
    return f"\n\n{part}\n\n"
