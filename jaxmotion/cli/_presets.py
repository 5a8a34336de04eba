"""Presets: ``--preset file.toml`` gives options other defaults. Keys at the top serve all commands,
those in a table of a command's name only it; what is typed on the command line wins.

    overwrite = true
    [denoise]
    strength = 0.8
    joints = ["Left*", "Hips"]
"""

import tomllib
from pathlib import Path
from typing import Any

import click

from jaxmotion._plain import in_words, irregular


def load_preset(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
    """Callback of ``--preset``."""
    if value is None:
        return
    ctx.meta["jaxmotion.preset"] = str(value)
    if kind := irregular(value):
        raise click.BadParameter(f"{value} is {kind}, not a file")
    try:
        table = tomllib.loads(value.read_text("utf-8"))
    except OSError as error:
        raise click.BadParameter(f"{value}: {in_words(error)}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise click.BadParameter(f"{value}: {error}") from None
    parent = ctx.parent
    group = parent.command if parent is not None else None
    commands = group.list_commands(parent) if isinstance(group, click.Group) and parent else []
    tables = {name: table.pop(name) for name in commands if isinstance(table.get(name), dict)}
    mine = tables.get(ctx.info_name or "", {})
    options = {
        name: p for p in ctx.command.params if isinstance(p, click.Option) for name in flags_of(p)
    }
    typos = {key for key in mine if _spelt(key) not in options}
    typos |= {key for key in table if _spelt(key) not in options.keys() | _all_flags(parent)}
    if typos:
        raise click.BadParameter(
            f"{value}: {', '.join(map(repr, sorted(typos)))} is no option of {ctx.info_name}; "
            f"there are {', '.join(sorted(options))}"
        )
    chosen = {_spelt(key): entry for key, entry in {**table, **mine}.items()}
    defaults = {
        options[key].name: _as_typed(entry) for key, entry in chosen.items() if key in options
    }
    ctx.default_map = {**(ctx.default_map or {}), **defaults}


def _all_flags(table: click.Context | None) -> set[str]:
    """Options of any command: a key for another one may stand at the top of a preset."""
    if table is None or not isinstance(table.command, click.Group):
        return set()
    commands = (table.command.get_command(table, n) for n in table.command.list_commands(table))
    params = (param for command in commands if command for param in command.params)
    return {name for param in params if isinstance(param, click.Option) for name in flags_of(param)}


def _spelt(key: str) -> str:
    return key.replace("_", "-")


def flags_of(option: click.Option) -> list[str]:
    """Its names without the dashes; the short one too only where there is no other."""
    long = [name for name in option.opts if name.startswith("--")]
    return [name.lstrip("-") for name in long or option.opts]


def _as_typed(entry: Any) -> Any:
    """A table such as ``gain = {"*Arm*" = 2}`` as the list of ``*Arm*=2`` one would type."""
    return [f"{key}={item}" for key, item in entry.items()] if isinstance(entry, dict) else entry
