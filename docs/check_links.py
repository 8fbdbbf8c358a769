"""Check a built documentation: `python docs/check_links.py docs/_build/html`.

Every link inside it leads to a page and a place that exist, and nothing is loaded from elsewhere,
so that it reads without a network.
"""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {"script": "src", "link": "href", "img": "src", "source": "src", "object": "data"}
"""Element -> the attribute by which it loads something."""


class Page(HTMLParser):
    """What a page links to, what it loads, and the places that can be linked to."""

    def __init__(self, path: Path):
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.places: set[str] = {"", "top"}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = {name: value or "" for name, value in attrs}
        self.places |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        elif tag in LOADED and LOADED[tag] in given and given.get("rel") not in ("canonical",):
            self.loaded.append(given[LOADED[tag]])


def broken(folder: Path) -> list[str]:
    """Return a sentence for each link that leads nowhere and each thing loaded from elsewhere."""
    pages = {path.resolve(): Page(path) for path in sorted(folder.rglob("*.html"))}
    if not pages:
        return [f"{folder}: there are no pages"]
    found = []
    for path, page in pages.items():
        where = path.relative_to(folder.resolve())
        for link in (*page.links, *page.loaded):
            parts = urlsplit(link)
            if parts.scheme or parts.netloc:
                if link in page.loaded and parts.scheme != "data":
                    found.append(f"{where} loads {link}")
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            place = unquote(parts.fragment)
            known = pages[target].places if target in pages else {"", place}
            if not target.is_file() or place not in known:
                found.append(f"{where} links to {link}")
    return found


if __name__ == "__main__":
    complaints = broken(Path(sys.argv[1]))
    print(
        "\n".join(complaints) or "every link leads somewhere, and nothing is loaded from elsewhere"
    )
    sys.exit(bool(complaints))
