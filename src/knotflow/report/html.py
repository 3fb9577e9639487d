"""Markdown to one HTML page's body: figures inlined, verdicts coloured, headings linkable."""

from __future__ import annotations

import re
from collections.abc import Sequence

from markdown_it import MarkdownIt
from markdown_it.token import Token

from knotflow.report.style import Picture
from knotflow.report.verdict import Verdict


def slug(title: str) -> str:
    """The anchor a code host gives a heading: `Fig. 6: rates` is `fig-6-rates`."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def to_html(markdown: str, pictures: Sequence[Picture]) -> str:
    """The page's body. An image of one of `pictures` becomes that picture's own SVG."""
    parser = MarkdownIt("commonmark", {"html": True}).enable("table")
    inline = {f"figures/{picture.name}.png": picture.inline() for picture in pictures}

    def image(_: object, tokens: Sequence[Token], index: int, *__: object) -> str:
        return inline[str(tokens[index].attrs["src"])]

    def table_open(*_: object) -> str:
        return '<div class="wide"><table>\n'

    def table_close(*_: object) -> str:
        return "</table></div>\n"

    parser.add_render_rule("image", image)
    parser.add_render_rule("table_open", table_open)
    parser.add_render_rule("table_close", table_close)
    tokens = parser.parse(markdown)
    for opening, inner in zip(tokens, tokens[1:], strict=False):
        if inner.type != "inline":
            continue
        if opening.type == "heading_open":
            opening.attrs["id"] = slug(inner.content)
        elif opening.type == "paragraph_open" and _is_figure(inner):
            _as_figure(opening, inner, tokens[tokens.index(inner) + 1])
        elif opening.type == "td_open":
            for verdict in Verdict:
                if inner.content.startswith(f"**{verdict}**"):
                    opening.attrs["class"] = f"verdict {slug(verdict)}"
    return str(parser.renderer.render(tokens, parser.options, {})).strip()


def _is_figure(inner: Token) -> bool:
    return bool(inner.children) and inner.children[0].type == "image"  # type: ignore[index]


def _as_figure(opening: Token, inner: Token, closing: Token) -> None:
    """A paragraph of an image and emphasised words: a figure and its caption."""
    opening.tag = closing.tag = "figure"
    for child in inner.children or []:
        if child.type in ("em_open", "em_close"):
            child.tag = "figcaption"
