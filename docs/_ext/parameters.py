"""Parameters and attributes of the reference as tables: a name and its meaning in each row.

Sphinx lists them as "name – meaning"; so this takes the lists apart again.
"""

from __future__ import annotations

from docutils import nodes

TABLES = {"Parameters", "Variables", "Raises"}
"""Fields that become tables."""
NAMES = {"Variables": "Attributes"}
"""Fields that have another name in the code."""


def tabulate(_app: object, page: nodes.document) -> None:
    """Turn the fields of a page that list names into tables."""
    for field in list(page.findall(nodes.field)):
        head, body = field.children
        title = head.astext()
        if title in TABLES:
            one = not isinstance(body[0], nodes.bullet_list)
            items = [body.children] if one else [item.children for item in body[0].children]
            body.children = []
            body += _table([_divided(item) for item in items])
            head.children = []
            head += nodes.Text(NAMES.get(title, title))


def _divided(item: list[nodes.Node]) -> tuple[list[nodes.Node], list[nodes.Node]]:
    """Return what stands before the dash of an item, and all that stands behind it."""
    first, *more = item
    for i, part in enumerate(first.children):
        before, dash, behind = str(part).partition(" – ") if _plain(part) else ("", "", "")
        if dash:
            name = [*first.children[:i], *([nodes.Text(before)] if before else [])]
            said = nodes.paragraph("", "", nodes.Text(behind), *first.children[i + 1 :])
            return name, [said, *more]
    return list(first.children), more


def _plain(part: nodes.Node) -> bool:
    return isinstance(part, nodes.Text)


def _table(rows: list[tuple[list[nodes.Node], list[nodes.Node]]]) -> nodes.table:
    """Return a table of two columns."""
    group, body = nodes.tgroup(cols=2), nodes.tbody()
    group += [nodes.colspec(colwidth=1), nodes.colspec(colwidth=3), body]
    for name, said in rows:
        row = nodes.row()
        row += nodes.entry("", nodes.paragraph("", "", *name))
        row += nodes.entry("", *said)
        body += row
    return nodes.table("", group, classes=["parameters"])
