"""One function over many motion files, in this process or on a cluster.

Every file is one piece of work: read, handed to the function, written whole to its place below the
output folder. It can be done twice without harm, so a lost worker costs its time and nothing else;
what goes wrong with one file is told of it and stops no other.
"""

import os
import time
import warnings
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from jaxmotion._caller import Caller
from jaxmotion._checks import static
from jaxmotion._cluster.connections import connected
from jaxmotion._cluster.tasks import Lost, stream
from jaxmotion._plain import in_words, printable
from jaxmotion.corpus import places
from jaxmotion.io import MotionFileError, load, save
from jaxmotion.io.atomic import remove_abandoned, replacing
from jaxmotion.io.formats import WRITTEN, Up, unknown_suffix

if TYPE_CHECKING:
    from distributed import Client

    from jaxmotion.motion import Motion


_SHOWN = 80  # letters of a status that are printed


class Mapped(NamedTuple):
    """What became of one file.

    ``source`` and ``target``: its name and its output's; ``status``: "written", "skipped" or
    "failed"; ``message``: why, of the last two; ``warnings``: texts; ``seconds``: it took.
    """

    source: str
    target: str
    status: str
    message: str = ""
    warnings: tuple[str, ...] = ()
    seconds: float = 0.0

    def __repr__(self) -> str:
        text = f"{self.source}: {self.status}, {self.message}".removesuffix(", ")
        short = text if len(text) <= _SHOWN else f"{text[: _SHOWN - 1]}…"
        return f"Mapped({printable(short)})"


class _File(NamedTuple):
    """What is to be read, and where the outcome goes."""

    source: str
    target: str


@static("overwrite", "resume")
def map(
    function: "Callable[[Motion], Motion]",
    files: str | PathLike | Sequence[str | PathLike],
    out: str | PathLike,
    *,
    client: "Client | str | None" = None,
    to: str | None = None,
    fps: float | int | None = None,
    up: Up | None = None,
    overwrite: bool = False,
    resume: bool = False,
    tell: Callable[[Mapped], object] | None = None,
) -> list[Mapped]:
    """Send every motion file through a function, and write what comes out.

    Outputs have the inputs' names, in a tree like theirs. Each is whole or not there. A file that
    fails is told in its status and stops no other; neither does a worker that dies, whose files are
    done again. JAX's 64-bit types and the folder of compiled programs, if it is set, are those of
    this process on workers too; other settings are not. Clips of many lengths are best padded to a
    few by the function itself, or every length is compiled for.

    **Arguments:** ``function``: takes a :class:`~jaxmotion.Motion` and returns one; with a client
    it is pickled, with all that it holds, and sent to every worker once; ``files``: names of files,
    of folders, which are searched, or patterns such as ``"takes/*.bvh"``, or URLs such as
    ``"s3://bucket/takes"``, for which fsspec and its package for them must be there; ``out``: the
    folder or URL to write to, which workers share; ``client``: a ``dask.distributed.Client``, the
    address of a scheduler, or "local" for workers of this machine (:func:`local_client`); None for
    this process; ``to``: suffix of the outputs, by default each input's own; ``fps``, ``up``: as
    :func:`jaxmotion.load` takes them; ``overwrite``: replace outputs that exist; ``resume``: skip
    those that are newer than their inputs, whatever function made them; ``tell``: called with every
    status as it comes.
    **Returns:** a :class:`Mapped` a file, in the order of the files.
    **Raises:** ``FileNotFoundError`` where there is no motion file; ``ValueError`` for two inputs
    of one output, an output that is an input, or a suffix that is not written; ``ConnectionError``
    when no scheduler answers, or one is gone; ``ImportError`` for a client or URL without the extra
    ``jaxmotion[distributed]``.

    **Example:**

        >>> import tempfile, jaxmotion as jm
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     jm.save(jm.samples.load("walk").motion, f"{folder}/walk.bvh")
        ...     done = jm.corpus.map(lambda motion: motion[:60], folder, f"{folder}/out")
        >>> [status.status for status in done]
        ['written']
    """
    jobs = _planned([files] if isinstance(files, str | PathLike) else files, out, to)
    outcomes: dict[_File, Mapped] = {}

    def note(status: Mapped) -> None:
        outcomes[_File(status.source, status.target)] = status
        if tell is not None:
            tell(status)

    ready = []
    for job in jobs:
        early = _known(job, overwrite=overwrite, resume=resume)
        if early is None:
            ready.append(job)
        else:
            note(early)
    work = _Work(function, fps, up, overwrite)
    _remove_temporary(ready)
    if client is None:
        for job in ready:
            note(work(job))
    elif ready:
        _on_cluster(client, work, ready, note)
    return [outcomes[job] for job in jobs]


def _on_cluster(
    client: "Client | str", work: "_Work", jobs: list[_File], note: Callable[[Mapped], None]
) -> None:
    there = _There(work, Caller.here(), os.getcwd())
    with ExitStack() as stack:
        stack.callback(_remove_temporary, jobs)
        connection = stack.enter_context(connected(client))
        pairs = stream(
            connection,
            there,
            jobs,
            name="jaxmotion-map",
            size=lambda job: places.size(job.source),
            refused=lambda job: "" if work.overwrite else _taken(job),
        )
        for job, value in stack.enter_context(closing(pairs)):
            note(Mapped(*job, "failed", value.reason) if isinstance(value, Lost) else value)


@dataclass(frozen=True)
class _Work:
    """What is done to every file."""

    function: "Callable[[Motion], Motion]"
    fps: float | int | None
    up: Up | None
    overwrite: bool

    def __call__(self, job: _File) -> Mapped:
        begun = time.perf_counter()
        status, message = "written", ""
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                self._do(job)
            except (Exception, SystemExit) as error:
                status, message = "failed", _described(error)
        said = [message, *(str(w.message) for w in caught)]
        for name in job:
            said = [places.of_the_original(text, name) for text in said]
        texts = tuple(dict.fromkeys(said[1:]))
        return Mapped(*job, status, said[0], texts, time.perf_counter() - begun)

    def _do(self, job: _File) -> None:
        from jaxmotion.motion import Motion

        with places.at_hand(job.source) as path:
            motion = load(path, fps=self.fps, up=self.up)
        result = self.function(motion)
        if not isinstance(result, Motion):
            raise ValueError(f"the function returned a {type(result).__name__}; expected a Motion")
        places.put(lambda path: save(result, path, overwrite=self.overwrite), job.target)


@dataclass(frozen=True)
class _There:
    """The same on a worker: with the caller's types, and replacing what a lost worker left."""

    work: _Work
    caller: Caller
    folder: str

    def prepare(self) -> None:
        """Import JAX, and share the folder of compiled programs."""
        self.caller.share()

    def __call__(self, job: _File) -> Mapped:
        if misfit := self.caller.misfit():
            return Mapped(*job, "failed", misfit)
        self.prepare()
        seen = _File(*(places.within(self.folder, name) for name in job))
        with self.caller.types(), replacing():
            status = self.work(seen)
        return status._replace(source=job.source, target=job.target)


def _planned(files: Sequence[str | PathLike], out: str | PathLike, to: str | None) -> list[_File]:
    """A job a file, no output an input, and none written twice."""
    if to is not None and f".{to.removeprefix('.')}" not in WRITTEN:
        raise unknown_suffix(Path(f"x.{to.removeprefix('.')}"), writing=True)
    found, folder = places.found(files), places.plain(out)
    jobs = []
    for item in found:
        target = places.below(folder, item.relative)
        if to is not None:
            stem = target[: target.rindex(".")]
            target = f"{stem}.{to.removeprefix('.')}"
        jobs.append(_File(item.name, target))
    names = {_real(name) for job in jobs for name in (job.source, *places.skeletons_of(job.source))}
    targets: dict[str, str] = {}
    for job in jobs:
        for made in places.made(job.target):
            if _real(made) in names:
                raise ValueError(f"map: {printable(made)} would be written over an input")
            other = targets.setdefault(_real(made), job.source)
            if other != job.source and made == job.target:
                raise ValueError(
                    f"map: {printable(other)} and {printable(job.source)} would both be written "
                    f"to {printable(made)}"
                )
    return jobs


def _real(name: str) -> str:
    return places.full(name) if places.is_url(name) else str(Path(name).resolve())


def _known(job: _File, *, overwrite: bool, resume: bool) -> Mapped | None:
    """What is known of a file before any work on it."""
    times = [places.time_of(name) for name in places.made(job.target)]
    if resume and None not in times:
        made = min(time for time in times if time is not None)
        if not made or made >= (places.time_of(job.source) or 0.0):
            return Mapped(*job, "skipped", "newer than its input")
    taken = "" if overwrite or times.count(None) == len(times) else _taken(job)
    return Mapped(*job, "failed", taken) if taken else None


def _taken(job: _File) -> str:
    """Why an output may not be written."""
    there = [name for name in places.made(job.target) if places.time_of(name) is not None]
    return f"{printable(there[0])} exists; pass overwrite=True to replace it" if there else ""


def _remove_temporary(jobs: Sequence[_File]) -> None:
    """Take away what killed processes left half-written where outputs go."""
    for folder in {Path(job.target).parent for job in jobs if not places.is_url(job.target)}:
        remove_abandoned(folder)


def _described(error: BaseException) -> str:
    if isinstance(error, MotionFileError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        where = f"{printable(error.filename)}: " if error.filename else ""
        return f"{where}{in_words(error)}"
    text = " ".join(str(error).split())
    return f"{type(error).__name__}: {text}" if text else type(error).__name__
