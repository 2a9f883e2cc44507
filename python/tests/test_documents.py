"""The code of the documents and of docstrings is run."""

from __future__ import annotations

import doctest
import re
from pathlib import Path

import pytest

import splitplane

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", ["docs/guide/src/first.md", "docs/guide/src/python.md", "python/README.md"])
def test_code_of_documents(name: str) -> None:
    run_blocks(name)


@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore:.*unraisable.*")
def test_code_of_the_page_on_dask() -> None:
    pytest.importorskip("distributed", reason="dask[distributed] is not installed")
    run_blocks("docs/guide/src/dask.md")


def run_blocks(name: str) -> None:
    text = (ROOT / name).read_text()
    blocks = list(re.finditer(r"^```python\n(.*?)^```", text, re.M | re.S))
    assert blocks and text.count("```python") == len(blocks)
    space: dict[str, object] = {}
    for block in blocks:
        # Errors name the line of the document.
        lines = text[: block.start(1)].count("\n")
        exec(compile("\n" * lines + block[1], str(ROOT / name), "exec"), space)


def test_docstrings() -> None:
    assert doctest.testmod(splitplane).attempted >= 3
    assert doctest.testmod(splitplane).failed == 0


def test_everything_public_has_a_docstring() -> None:
    for name in splitplane.__all__:
        thing = getattr(splitplane, name)
        if isinstance(thing, type):
            assert thing.__doc__, name
            for own, member in vars(thing).items():
                if not own.startswith("_") and (callable(member) or isinstance(member, property)):
                    assert member.__doc__, f"{name}.{own}"
