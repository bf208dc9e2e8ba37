"""Check a built site from disk, without a network: ``python tools/check_site.py site``.

Every link, picture, script, style and frame of every page has to lead to a file of the site, every anchor to an element of that
page; and no page may load anything from another host. What is dead is printed, and the exit status is 1.
"""

from __future__ import annotations

import posixpath
import re
import sys
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

LOADED = {("img", "src"), ("script", "src"), ("link", "href"), ("iframe", "src"), ("source", "src"), ("video", "src")}
"""What a browser fetches by itself; of `link` only where `rel` is one of those below."""
FETCHED = {"stylesheet", "icon", "preload", "modulepreload", "preconnect", "manifest"}


@dataclass
class Page(HTMLParser):
    """What a page offers to be linked to, and what it links to."""

    ids: set[str] = field(default_factory=set)
    links: list[str] = field(default_factory=list)
    """Where a reader may go."""
    loads: list[str] = field(default_factory=list)
    """What the page itself fetches."""
    canonical: str = ""
    """The address that it says it has."""

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take in an element."""
        given = {name: value or "" for name, value in attrs}
        self.ids |= {given[name] for name in ("id", "name") if name in given}
        if given.get("rel") == "canonical":
            self.canonical = given.get("href", "")
        for name in ("href", "src"):
            fetched = tag != "link" or FETCHED.intersection(given.get("rel", "").split())
            if name in given:
                (self.loads if (tag, name) in LOADED and fetched else self.links).append(given[name])


def dead(site: Path) -> list[str]:
    """Return a sentence for each link of a site that leads nowhere and each thing that it loads from elsewhere."""
    pages = {path.resolve(): _read(path) for path in sorted(site.rglob("*.html"))}
    if not pages:
        return [f"{site}: no page is there"]
    # The page for what is not found is shown in any folder, so its links begin at the root of the host.
    front = pages.get((site / "index.html").resolve(), Page())
    base = posixpath.dirname(urlsplit(front.canonical).path).strip("/")
    found, root = [], site.resolve()
    for path, page in pages.items():
        name = path.relative_to(root)
        found += [f"{name}: loads {url} from another host" for url in page.loads if urlsplit(url).netloc]
        own = [url for url in (*page.links, *page.loads) if not urlsplit(url).netloc and urlsplit(url).scheme in ("", "file")]
        found += [f"{name}: {url} {why}" for url in dict.fromkeys(own) if (why := _missing(url, path, pages, root, base))]
    for path in sorted(site.rglob("*.css")):
        for url in re.findall(r"url\(\s*['\"]?([^'\")]+)", path.read_text(encoding="utf-8")):
            if urlsplit(url).netloc:
                found.append(f"{path.relative_to(site)}: loads {url} from another host")
    return found


def _read(path: Path) -> Page:
    page = Page()
    page.feed(path.read_text(encoding="utf-8"))
    return page


def _missing(url: str, path: Path, pages: dict[Path, Page], site: Path, base: str) -> str:
    """Return why a link of a page is dead, nothing where it is not."""
    parts = urlsplit(url)
    given = unquote(parts.path)
    if given.startswith("/"):
        target = (site / given.lstrip("/").removeprefix(base).lstrip("/")).resolve()
    else:
        target = (path.parent / given).resolve() if given else path
    if target.is_dir():
        target /= "index.html"
    if not target.is_file():
        return "leads to no file"
    # A fragment with a sign of equality, as in #t=6.20, is for the script of a page.
    anchor = unquote(parts.fragment)
    if anchor and "=" not in anchor and target in pages and anchor not in pages[target].ids:
        return "names no element of that page"
    return ""


def main() -> int:
    """Check the site named on the command line."""
    if len(sys.argv) != 2:
        print("usage: python tools/check_site.py SITE", file=sys.stderr)
        return 2
    site = Path(sys.argv[1])
    found = dead(site)
    for line in found:
        print(line)
    pages = len(list(site.rglob("*.html")))
    print(f"{pages} pages, {len(found)} dead links or foreign loads")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
