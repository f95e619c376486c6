"""The README's own code runs."""

import pathlib
import re

import pytest

README = (pathlib.Path(__file__).parent.parent / "README.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def test_the_readme_has_code_for_each_layer():
    assert len(BLOCKS) == 6


@pytest.mark.parametrize(
    "block", BLOCKS, ids=["environment", "batch", "training", "recording", "solver", "ground"]
)
def test_the_readmes_code_runs(block, capsys):
    names = {}
    exec(compile(block, "README.md", "exec"), names)
    if "policy" in names:
        assert names["info"]["is_success"] is True


def test_every_file_that_the_readme_shows_is_there():
    for path in re.findall(r"\]\((docs/[^)]+)\)", README):
        assert (pathlib.Path(__file__).parent.parent / path).is_file(), path
