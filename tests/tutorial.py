"""Draws the solutions of the tutorial's sections, for its pages."""

import re
from contextlib import chdir
from pathlib import Path
from tempfile import TemporaryDirectory

PAGE = Path(__file__).parents[1] / "showc" / "docs" / "ocp-tutorial.md"


def draw() -> None:
    """Run the sections one after the other and save what each solves last."""
    names: dict[str, object] = {}
    folder = PAGE.parent / "tutorial"
    folder.mkdir(exist_ok=True)
    for section in re.split(r"(?m)^(?=## )", PAGE.read_text(encoding="utf-8")):
        for block in re.findall(r"```python\n(.*?)```", section, re.DOTALL):
            code = block.replace('solution.plot().save("cart.svg")', "")
            with TemporaryDirectory() as room, chdir(room):
                exec(compile(code, str(PAGE), "exec"), names)  # noqa: S102 - ours
        if number := re.match(r"## (\d+)\.", section):
            names["solution"].plot().save(folder / f"{number[1]}.svg")
