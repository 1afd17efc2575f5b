"""Hooks of the documentation site."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from scripts.site_links import on_page_markdown


@pytest.mark.parametrize(
    ("page", "repo", "text", "expected"),
    [
        ("a.md", None, "[x](../examples/x.toml)", "x (`examples/x.toml`)"),
        ("a.md", None, "[examples/x.toml](../examples/x.toml)", "examples/x.toml"),
        ("a.md", "https://e.org/r/", "[x](../b.md)", "[x](https://e.org/r/blob/main/b.md)"),
        ("d/a.md", None, "[x](../model.md)", "[x](../model.md)"),
        ("d/a.md", None, "[x](../../b.md#c)", "x (`b.md`)"),
        ("a.md", None, "[x](model.md) ![y](y.svg)", "[x](model.md) ![y](y.svg)"),
    ],
)
def test_links_that_leave_the_pages_name_the_file(
    page: str, repo: str | None, text: str, expected: str
) -> None:
    file = SimpleNamespace(file=SimpleNamespace(src_uri=page))
    assert on_page_markdown(text, file, SimpleNamespace(repo_url=repo)) == expected
