"""Generated parts of a text file: each stands between <!-- NAME --> and <!-- /NAME -->."""

from pathlib import Path


def fill(path: Path, parts: dict[str, str]) -> None:
    """Put each text between the marks of its name."""
    text = path.read_text()
    for name, part in parts.items():
        begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
        head, rest = text.split(begin)
        text = f"{head}{begin}{part}{end}{rest.split(end)[1]}"
    path.write_text(text)
