"""A report as one HTML file that needs nothing else: style, figures and all in it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from importlib import resources

from .._utils.version import __version__
from .document import Figure, Report, Section, Table, Text
from .figures import draw

#: Tables longer than this may break over printed pages; those longer than the other have a field to find rows.
_LONG = 18
_SEARCHED = 12
#: Rows without the words that were typed are left out; without a script everything is there.
_FIND = """document.querySelectorAll("input.find").forEach(function (field) {
  field.hidden = false;
  field.addEventListener("input", function () {
    var words = field.value.toLowerCase().split(/\\s+/);
    field.nextElementSibling.querySelectorAll("tbody tr").forEach(function (row) {
      var text = row.textContent.toLowerCase();
      row.hidden = !words.every(function (word) { return text.includes(word); });
    });
  });
});"""


def to_html(report: Report, drawn: dict[str, bytes] | None = None) -> str:
    """The whole page. `drawn`: SVG of figures by name, where they are at hand. Raises ConfigurationError without matplotlib."""
    style = resources.files(__package__).joinpath("report.css").read_text()
    drawn = {f.name: draw(f) for f in report.figures} if drawn is None else drawn
    sections = "\n".join(_section(s, drawn) for s in report.sections)
    return f"""<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>{escape(report.headline)}</title>
<style>
{style}</style>
</head>
<body class="{escape(report.kind)}">
<main>
<h1>{escape(report.headline)}</h1>
<p class="subject">{escape(report.subject)}</p>
{sections}
<footer>ident {escape(__version__)}</footer>
</main>
<script>
{_FIND}
</script>
</body>
</html>
"""


def to_fragment(sections: Sequence[Section]) -> str:
    """Texts and tables as a piece of a page, for notebooks: no style of its own, so that it is dark where the notebook is."""
    return "\n".join(_section(s, {}) for s in sections if not isinstance(s, Figure))


def _section(section: Section, drawn: dict[str, bytes]) -> str:
    if isinstance(section, Text):
        body, long = "\n".join(f"<p>{escape(line)}</p>" for line in section.lines), len(section.lines) > _LONG
    elif isinstance(section, Table):
        body, long = _table(section), len(section.rows) > _LONG
    else:
        body, long = _figure(section, drawn[section.name]), False
    mark = ' class="long"' if long else ""
    return f"<section{mark}>\n<h2>{escape(section.title)}</h2>\n{body}\n</section>"


def _table(table: Table) -> str:
    def row(cells: tuple[str, ...], tag: str) -> str:
        marks = (' class="word"' if i < table.left else "" for i in range(len(cells)))
        return "<tr>" + "".join(f"<{tag}{mark}>{escape(cell)}</{tag}>" for mark, cell in zip(marks, cells, strict=True)) + "</tr>"

    body = "\n".join(row(cells, "td") for cells in table.rows)
    note = f'\n<p class="note">{escape(table.note)}</p>' if table.note else ""
    find = (
        '<input class="find" type="search" placeholder="find rows" aria-label="find rows" hidden>\n' if len(table.rows) > _SEARCHED else ""
    )
    return f'{find}<div class="wide"><table>\n<thead>{row(table.head, "th")}</thead>\n<tbody>\n{body}\n</tbody>\n</table></div>{note}'


def _figure(figure: Figure, svg: bytes) -> str:
    source = "data:image/svg+xml;base64," + base64.b64encode(svg).decode()
    caption = f"\n<figcaption>{escape(figure.caption)}</figcaption>" if figure.caption else ""
    return f'<figure>\n<img alt="{escape(figure.title)}" src="{source}">{caption}\n</figure>'
