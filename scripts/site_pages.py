"""A hook of mkdocs: pages that are made for the site alone.

The mechanism of the demo, which turns on the first page; a page for each term, with what it leaves
in the residual; the gallery as thumbnails that lead there.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

import rsicalib
from rsicalib.report.page import mechanism_page

DOCS = Path(__file__).parents[1] / "docs"

SECTION = re.compile(r"^## (\w+)\n(.*?)(?=^## |\Z)", re.M | re.S)
"""A section with its name and its text."""


def term_pages() -> dict[str, str]:
    """A page for each term: its section of the page of terms, and its picture of the gallery."""
    text = (DOCS / "terms.md").read_text(encoding="utf-8")
    pages = {}
    for name, inner in SECTION.findall(text):
        # Links and pictures are told from a folder below.
        inner = re.sub(r"\]\((?!https?:|#|terms/)([^)]+)\)", r"](../\1)", inner)
        inner = inner.replace("](terms/", "](").replace("](#", "](../terms.md#")
        left = ""
        if (DOCS / "gallery" / f"{name}.svg").is_file():
            words = "Residual of a session with it, before the trace"
            left = f"## What it leaves\n\n![{words}](../gallery/{name}.svg)\n\n"
        pages[name] = f"# {name}\n{inner}\n{left}[All terms](../terms.md)\n"
    return pages


def thumbnails(text: str) -> str:
    """The gallery with its sections as thumbnails; what stands before them stays."""
    head = text[: text.index("\n## ")]
    cards = []
    for name, inner in SECTION.findall(text):
        words = re.sub(r"\[More\].*", "", inner, flags=re.S).strip()
        cards.append(f"[![]({'gallery/' + name}.svg) **{name}** {words}](terms/{name}.md)")
    inner = "\n\n".join(cards)
    return f'{head}\n\n<div class="thumbs" markdown>\n\n{inner}\n\n</div>\n'


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the mechanism of the first page, and the pages of terms."""
    found = rsicalib.demo()
    assert found.evidence is not None
    content = mechanism_page(found, found.evidence)
    files.append(File.generated(config, "hero.html", content=content))
    for name, text in term_pages().items():
        files.append(File.generated(config, f"terms/{name}.md", content=text))
    return files


def on_page_content(html: str, **_: Any) -> str:
    """A head of a table without words is none."""
    return re.sub(r"<th( [^>]*)?></th>", r"<td\1></td>", html)


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The mechanism that turns, the gallery in thumbnails, links from the list of terms."""
    if page.file.src_uri == "index.md":
        frame = r'<iframe class="moving" src="hero.html" title="\1"></iframe>'
        return re.sub(r"!\[(.*)\]\(report\.png\)", frame, markdown)
    if page.file.src_uri == "gallery.md":
        return thumbnails(markdown)
    if page.file.src_uri == "terms.md":
        return re.sub(r"^- \[(\w+)\]\(#\1\)", r"- [\1](terms/\1.md)", markdown, flags=re.M)
    return markdown
