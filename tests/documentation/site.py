"""An extension of Python-Markdown that puts in what is made from the program.

A line ``<!-- made from the program: NAME -->`` of a page becomes what the function of that name in
``PARTS`` returns.
"""

import re
from typing import Any

from markdown import Markdown
from markdown.extensions import Extension
from markdown.preprocessors import Preprocessor

from tests.documentation.reference import PARTS

_MARK = re.compile(r"<!-- made from the program: (\w+) -->")


class _FromTheProgram(Preprocessor):
    def run(self, lines: list[str]) -> list[str]:
        """Replace each mark."""
        text = "\n".join(lines)
        return _MARK.sub(lambda mark: PARTS[mark[1]](), text).split("\n")


class FromTheProgram(Extension):
    """Parts of pages that are made from the program."""

    def extendMarkdown(self, md: Markdown) -> None:
        """Run before code blocks and HTML comments are taken out of the text."""
        md.preprocessors.register(_FromTheProgram(md), "from-the-program", priority=1000)


def makeExtension(**options: Any) -> FromTheProgram:
    """Return the extension, under the name that Python-Markdown looks for."""
    return FromTheProgram(**options)
