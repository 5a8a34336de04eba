"""``{commands}``: a section for every command of the command line, with what its --help says."""

import click
from docutils import nodes
from sphinx.util.docutils import SphinxDirective

from jaxmotion.cli._app import app as table

WIDTH = 92  # letters of a line, which a page has room for


class Commands(SphinxDirective):
    def run(self):
        with click.Context(table, info_name="jaxmotion", terminal_width=WIDTH) as above:
            return [self.section(above, name) for name in table.list_commands(above)]

    def section(self, above, name):
        found = nodes.section(ids=[nodes.make_id(name)], names=[name])
        found += nodes.title(text=name)
        found += nodes.literal_block(text=said(above, name), language="none")
        self.state.document.note_explicit_target(found)
        return found


def said(above, name):
    """The help of a command, as a terminal shows it."""
    command = table.get_command(above, name)
    with click.Context(command, info_name=name, parent=above, terminal_width=WIDTH) as here:
        return command.get_help(here)


def setup(app):
    app.add_directive("commands", Commands)
    return {"parallel_read_safe": True}
