"""What work takes along to a worker from the process that asks for it."""

from contextlib import AbstractContextManager
from importlib import metadata
from typing import NamedTuple

from jaxmotion._compilation_cache import folder_of_programs, share_programs
from jaxmotion._width import kept_wide, wide


class Caller(NamedTuple):
    """The asking process: whether JAX keeps 64 bits there, where compiled programs are kept, and
    JAX's release, on which last digits depend."""

    x64: bool
    programs: str | None
    release: str

    @classmethod
    def here(cls) -> "Caller":
        """This process."""
        return cls(wide(), folder_of_programs(), metadata.version("jax"))

    def misfit(self) -> str:
        """Why this process may not do its work; empty if it may."""
        here = metadata.version("jax")
        if here == self.release:
            return ""
        return f"the worker has jax {here}, its client {self.release}"

    def share(self) -> None:
        """Keep compiled programs where it does, from now on."""
        share_programs(self.programs)

    def types(self) -> AbstractContextManager:
        """Its 64-bit types, or none, for a while."""
        return kept_wide(self.x64)
