"""Markdown to one HTML page's body: figures linked, verdicts coloured, headings linkable."""

from __future__ import annotations

import re

from markdown_it import MarkdownIt
from markdown_it.token import Token

from knotflow.report.claims import Verdict


def slug(title: str) -> str:
    """The anchor a code host gives a heading: `Fig. 6: rates` is `fig-6-rates`."""
    return re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-")


def to_html(markdown: str) -> str:
    """The page's body. Figures are linked as SVG, which stays sharp on every screen."""
    parser = MarkdownIt("commonmark", {"html": True}).enable("table")
    parser.add_render_rule("table_open", lambda *_: '<div class="wide"><table>\n')
    parser.add_render_rule("table_close", lambda *_: "</table></div>\n")
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
        if child.type == "image":
            child.attrs["src"] = str(child.attrs["src"]).removesuffix(".png") + ".svg"
        elif child.type in ("em_open", "em_close"):
            child.tag = "figcaption"
