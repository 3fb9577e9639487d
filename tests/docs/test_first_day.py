"""The snippets of the first day run as they stand, one after the other."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from knotflow.perception import Label

PAGE = Path(__file__).parents[2] / "docs" / "first_day.md"


@pytest.mark.slow
def test_the_snippets_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = PAGE.read_text("utf-8")
    space: dict[str, object] = {}
    for match in re.finditer(r"```python\n(.*?)```", text, re.DOTALL):
        # As many empty lines as stand before it, so that an error names the page's line.
        lead = "\n" * text[: match.start(1)].count("\n")
        exec(compile(lead + match[1], str(PAGE), "exec"), space)
    assert space["plan"].solved
    log = space["robot"].log
    assert log.count("grasp") == len(space["plan"].steps) and log[-1] == "release"
    assert set(space["labels"].ravel()) >= {Label.TABLE, Label.ROPE}
    assert (tmp_path / "overhand.csv").read_text().count("\n") > 20
