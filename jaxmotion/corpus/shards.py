"""A shard: many clips in one file that is mapped into memory, not read.

    bytes        holds
    0 – 7        ``JMCORPUS``
    8 – 11       version of this layout, u32
    12 – 15      length H of the header, u32
    16 – 19      CRC-32 of the header, u32
    20 – 63      nothing
    64 – 64 + H  the header: JSON, UTF-8, spaces at its end
    then         the arrays, each at a multiple of 64 bytes, C order; all numbers little-endian

| array | shape | holds |
|---|---|---|
| ``rotations`` | f[F, J, 4] | of all clips, one after the other |
| ``moved`` | f[F, M, 3] | translations of the joints that are translated in one of the clips |
| ``rest`` | f[C, J, 3] | translations of each clip's first frame |
| ``offsets``, ``ends`` | f[C, J, 3], f[C, E, 3] | of each clip's skeleton |
| ``moments`` | f64[C, J, 4, 4] | Σ q qᵀ over the clip's frames |

The header has ``arrays`` (of each its place in the file, shape, dtype and, but for the two long
ones, CRC-32), ``joints`` (the M), ``size`` of the file, and ``clips``: the ``name``, ``first``
frame, ``frames``, ``translated`` joints and ``crc`` of each, of its rows in the two long arrays; or
its ``fault`` in words, of one that cannot be used, which has no frames.

Nothing is pickled. Header and small arrays are checked when a shard is opened, the rows of a clip
when they are first asked for, so that opening costs nothing of what is not read.
"""

import json
import mmap
import struct
import zlib
from os import PathLike
from pathlib import Path
from typing import IO, Any, NamedTuple

import numpy as np

MAGIC = b"JMCORPUS"
VERSION = 1
_HEAD = struct.Struct("<8sIII")
_ALIGNED = 64
_LONG = ("rotations", "moved")
_SMALL = ("rest", "offsets", "ends", "moments")


class DamagedShard(Exception):
    """A shard that is not what was written, in words."""


class Clip(NamedTuple):
    """A clip as a shard holds it: ``rotations`` f[T, J, 4], ``moved`` f[T, M, 3] of ``joints``
    (a slice where they are neighbours), ``rest`` f[J, 3], ``offsets`` f[J, 3], ``ends`` f[E, 3],
    ``translated`` joints."""

    rotations: np.ndarray
    moved: np.ndarray
    rest: np.ndarray
    offsets: np.ndarray
    ends: np.ndarray
    joints: np.ndarray | slice
    translated: tuple[int, ...]

    def translations(self, frames: slice = slice(None)) -> np.ndarray:
        """Of some of the frames, f[T, J, 3], a copy."""
        moved = self.moved[frames]
        whole = np.empty((len(moved), *self.rest.shape), self.rest.dtype)
        self.put_translations(whole, moved)
        return whole

    def put_translations(self, place: np.ndarray, moved: np.ndarray) -> None:
        """Into f[T, J, 3]."""
        place[...] = self.rest
        place[:, self.joints] = moved


class Row(NamedTuple):
    """What is written of a clip: its ``name``, and its arrays, or the ``fault`` that it has."""

    name: str
    translations: np.ndarray | None = None
    rotations: np.ndarray | None = None
    offsets: np.ndarray | None = None
    ends: np.ndarray | None = None
    translated: tuple[int, ...] = ()
    fault: str | None = None


def write_shard(file: IO[bytes], rows: list[Row], joints: int, ends: int, dtype: Any) -> None:
    """Write a shard; the same rows give the same bytes."""
    kind = np.dtype(dtype).newbyteorder("<")
    moving = sorted({j for row in rows for j in row.translated})
    clips, long, small = [], {name: [] for name in _LONG}, {name: [] for name in _SMALL}
    first = 0
    for row in rows:
        if row.rotations is None or row.translations is None:
            q, moved = np.zeros((0, joints, 4), kind), np.zeros((0, len(moving), 3), kind)
            rest, offsets = np.zeros((2, joints, 3), kind)
            end_offsets = np.zeros((ends, 3), kind)
        else:
            q = np.ascontiguousarray(row.rotations, kind)
            moved = np.ascontiguousarray(row.translations[:, moving], kind)
            rest, offsets, end_offsets = row.translations[0], row.offsets, row.ends
        wide = q.astype(np.float64)
        of_row = (rest, offsets, end_offsets, wide.transpose(1, 2, 0) @ wide.transpose(1, 0, 2))
        for name, x in zip(_SMALL, of_row, strict=True):
            small[name].append(np.asarray(x, np.dtype("<f8") if name == "moments" else kind))
        for name, x in zip(_LONG, (q, moved), strict=True):
            long[name].append(x)
        about = {"name": row.name, "first": first, "frames": len(q)}
        about |= {"translated": list(row.translated), "crc": _crc(q, moved)}
        clips.append(about | ({} if row.fault is None else {"fault": row.fault}))
        first += len(q)
    arrays = {name: np.stack(x) for name, x in small.items()}
    shapes = {name: (first, *x[0].shape[1:]) for name, x in long.items()}
    shapes |= {name: x.shape for name, x in arrays.items()}
    header = {"joints": moving, "clips": clips, "arrays": {}, "size": 0}
    for name, shape in shapes.items():
        of = arrays[name].dtype if name in arrays else kind
        header["arrays"][name] = {"at": 0, "shape": shape, "dtype": of.str}
        if name in arrays:
            header["arrays"][name]["crc"] = _crc(arrays[name])
    text = _placed(header)
    file.write(_HEAD.pack(MAGIC, VERSION, len(text), zlib.crc32(text)).ljust(_ALIGNED, b"\0"))
    file.write(text)
    for name in shapes:
        for x in long.get(name, [arrays.get(name)]):
            file.write(memoryview(x).cast("B") if x.size else b"")  # type: ignore[union-attr]
        file.write(bytes(-_bytes(header["arrays"][name]) % _ALIGNED))


def _placed(header: dict[str, Any]) -> bytes:
    """The header as text, with the places of the arrays, which depend on how long it is."""
    for array in header["arrays"].values():
        array["at"] = 2**53  # as many digits as there may be
    header["size"] = 2**53
    room = len(json.dumps(header))
    room += -room % _ALIGNED
    at = _ALIGNED + room
    for array in header["arrays"].values():
        array["at"] = at
        at += _bytes(array) + -_bytes(array) % _ALIGNED
    header["size"] = at
    return json.dumps(header).encode("ascii").ljust(room)


def _bytes(array: dict[str, Any]) -> int:
    return int(np.prod(array["shape"], dtype=np.int64)) * np.dtype(array["dtype"]).itemsize


def _crc(*arrays: np.ndarray) -> int:
    code = 0
    for x in arrays:
        flat = np.ascontiguousarray(x).reshape(-1).view(np.uint8)
        code = zlib.crc32(flat, code)  # pyright: ignore[reportArgumentType]
    return code


class Shard:
    """An open shard.

    **Raises:** :class:`DamagedShard` if it was cut off or changed, or has another layout;
    ``OSError`` if it cannot be opened.
    """

    def __init__(self, path: str | PathLike):
        self.path = Path(path)
        with self.path.open("rb") as file:
            header = _header(file, self.path)
            self._map = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        try:
            self.clips: list[dict[str, Any]] = header["clips"]
            self.joints = [int(j) for j in header["joints"]]
            arrays = {name: self._array(header["arrays"][name]) for name in (*_LONG, *_SMALL)}
            self.crcs = [clip["crc"] for clip in self.clips]
            for name in _SMALL:
                if _crc(arrays[name]) != header["arrays"][name]["crc"]:
                    raise DamagedShard(f"{self.path} is damaged in its {name}")
        except (KeyError, TypeError, ValueError) as error:
            raise DamagedShard(f"{self.path} has a header that does not fit ({error})") from error
        self.rotations, self.moved = (arrays[name] for name in _LONG)
        self.rest, self.offsets, self.ends, self.moments = (arrays[name] for name in _SMALL)
        run = range(min(self.joints, default=0), max(self.joints, default=-1) + 1)
        alone = self.joints != list(run)
        self._columns = np.array(self.joints, np.intp) if alone else slice(run.start, run.stop)
        self._sound: set[int] = set()

    def clip(self, number: int) -> Clip:
        """A clip, whose arrays are read-only and lie in the file.

        **Raises:** :class:`DamagedShard` if its rows are not those that were written.
        """
        about = self.clips[number]
        rows = slice(about["first"], about["first"] + about["frames"])
        q, moved = self.rotations[rows], self.moved[rows]
        if number not in self._sound:
            if _crc(q, moved) != self.crcs[number]:
                raise DamagedShard(f"{self.path} is damaged in clip {number}, {about['name']}")
            self._sound.add(number)
        small = (self.rest[number], self.offsets[number], self.ends[number])
        return Clip(q, moved, *small, self._columns, tuple(about["translated"]))

    def _array(self, about: dict[str, Any]) -> np.ndarray:
        kind = np.dtype(about["dtype"])
        if kind.kind != "f":
            raise ValueError(f"dtype {kind}")
        count = int(np.prod(about["shape"], dtype=np.int64))
        found = np.frombuffer(self._map, kind, count, about["at"]).reshape(about["shape"])
        return found if kind.isnative else found.astype(kind.newbyteorder("="))


def _header(file: IO[bytes], path: Path) -> dict[str, Any]:
    head = file.read(_ALIGNED)
    if len(head) < _ALIGNED or head[:8] != MAGIC:
        raise DamagedShard(f"{path} is no shard of a corpus")
    _, version, length, code = _HEAD.unpack_from(head)
    if version != VERSION:
        raise DamagedShard(f"{path} has layout version {version}; this is {VERSION}")
    text = file.read(length)
    if len(text) < length or zlib.crc32(text) != code:
        raise DamagedShard(f"{path} is damaged in its header")
    header = json.loads(text)
    size = file.seek(0, 2)
    if size != header.get("size"):
        raise DamagedShard(f"{path} has {size} bytes; it was written with {header.get('size')}")
    return header
