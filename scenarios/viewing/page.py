"""Pages that list what became of a run and link its recordings: one style for all commands."""

import html
from collections.abc import Sequence

_STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; margin: 2rem auto; max-width: 70rem; color: #222;
  padding: 0 1rem }
h1 { font-size: 1.4rem }
.wide { overflow-x: auto }
table { border-collapse: collapse; width: 100% }
th, td { text-align: left; vertical-align: top; padding: .3rem .6rem }
th, td { border-bottom: 1px solid #ddd }
.ok { color: #1a7f37 } .failed { color: #b3261e }
img { max-width: 100% }
@media (max-width: 40rem) { body { margin: 1rem auto } th, td { padding: .25rem .35rem } }
"""


def text(value: object) -> str:
    """Return a cell that shows a value as it is written."""
    return html.escape(str(value))


def verdict(value: object, good: bool) -> str:
    """Return a cell in the colour of what went well, or of what did not."""
    return f'<span class="{"ok" if good else "failed"}">{text(value)}</span>'


def link(target: str | None, shown: str) -> str:
    """Return a cell that leads to a file beside the page; an empty one without a target."""
    return f'<a href="{html.escape(target)}">{text(shown)}</a>' if target else ""


def lines(cells: Sequence[str]) -> str:
    """Return a cell of several cells below each other."""
    return "<br>".join(cells)


def picture(file: str, shown: str) -> str:
    """Return a picture as wide as the page, from a file beside it, and what it shows in words."""
    return f'<p><img src="{html.escape(file)}" alt="{html.escape(shown)}"></p>'


def table_page(
    title: str,
    facts: Sequence[str],
    heads: Sequence[str],
    rows: Sequence[Sequence[str]],
    after: Sequence[str] = (),
) -> str:
    """Return a page: facts as a list, a table whose rows are of cells as those above, then more.

    What comes `after` the table are cells or pictures.
    """
    items = "".join(f"<li>{text(fact)}</li>" for fact in facts)
    first = "".join(f"<th>{text(head)}</th>" for head in heads)
    body = "\n".join(
        "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>" for cells in rows
    )
    return (
        f'<!doctype html><html lang="en"><meta charset="utf-8"><title>{text(title)}</title>'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<style>{_STYLE}</style><h1>{text(title)}</h1><ul>{items}</ul>"
        f'<div class="wide"><table><tr>{first}</tr>\n{body}\n</table></div>'
        f"{''.join(after)}</html>\n"
    )
