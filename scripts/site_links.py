"""A hook of mkdocs: links that leave `docs` name the file where the site has no page for it."""

from __future__ import annotations

import re
from typing import Any


def on_page_markdown(markdown: str, page: Any, config: Any, **_: Any) -> str:
    """Make links to other files of the repository into links to it, or into their paths.

    Parameters
    ----------
    markdown : str
        Text of a page.
    page : Page
        Its place among the pages.
    config : MkDocsConfig
        Where `repo_url` stands, if there is one.

    Returns
    -------
    str
        The text that is rendered.
    """
    depth = page.file.src_uri.count("/") + 1
    away = re.compile(rf"\[([^\]]*)\]\((?:\.\./){{{depth}}}(?!\.\./)([^)#\s]+)[^)]*\)")

    def replaced(match: re.Match[str]) -> str:
        text, path = match.groups()
        if config.repo_url:
            return f"[{text}]({config.repo_url.rstrip('/')}/blob/main/{path})"
        return text if path in text else f"{text} (`{path}`)"

    return away.sub(replaced, markdown)
