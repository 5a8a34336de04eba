"""Arrays out of an .npz file that may be damaged or hostile, and into one.

An .npz is a zip of .npy files. Pickled objects are refused, a header's shape is believed only as
far as the member's own bytes go, and whatever a broken zip, header or compression makes the
libraries raise comes out as :class:`~jaxmotion.io.MotionFileError`. Members are read one by one, so
arrays that nobody asked for (of any kind) do no harm.
"""

import io
import json
import math
import sys
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import IO

import numpy as np

from jaxmotion._plain import quoted
from jaxmotion.io.errors import MotionFileError, require_file


class Archive:
    """An .npz file: ``names`` of its arrays, and :meth:`read` for one of them.

    **Raises:** :class:`MotionFileError` if it is no zip file; ``OSError`` if it cannot be opened.
    """

    def __init__(self, path: str | PathLike):
        self.path = Path(path)
        require_file(path)
        with self.path.open("rb"):
            pass
        try:
            with zipfile.ZipFile(self.path) as archive:
                members = archive.namelist()
        except Exception as error:
            raise MotionFileError(
                path,
                f"a damaged archive ({error})",
                expected="an .npz file, written by NumPy",
                hint="copy or export the file again",
            ) from error
        self.names = tuple(name.removesuffix(".npy") for name in members)

    def read(self, name: str, what: str = "an array") -> np.ndarray:
        """The array called ``name``.

        **Raises:** :class:`MotionFileError` if there is none (``what`` says what it should hold),
        it holds pickled objects, or is damaged.
        """
        if name not in self.names:
            listed = ", ".join(map(quoted, self.names[:12])) or "none"
            raise MotionFileError(
                self.path,
                f"no array {name!r} (there are: {listed})",
                expected=f"{name!r}, {what}",
                hint="check that this is a motion, ours or AMASS",
            )
        try:
            return self._read(name)
        except MotionFileError:
            raise
        except Exception as error:
            raise MotionFileError(
                self.path,
                f"a damaged array {name!r} ({error})",
                expected=what,
                hint="copy or export the file again",
            ) from error

    def floats(self, name: str, dtype: np.dtype | None = None) -> np.ndarray:
        """The array called ``name``, of finite numbers, as ``dtype`` if one is given.

        **Raises:** as :meth:`read`, and for numbers that are no floats or not finite.
        """
        array = self.read(name, "an array of floats")
        if array.dtype not in (np.float32, np.float64):
            raise MotionFileError(
                self.path, f"{name!r} of dtype {array.dtype}", expected="float32 or float64"
            )
        with np.errstate(over="ignore"):
            array = array if dtype is None else array.astype(dtype)
        bad = np.argwhere(~np.isfinite(array))
        if len(bad):
            raise MotionFileError(
                self.path,
                f"{array[tuple(bad[0])]} in {name!r} at {tuple(bad[0].tolist())}",
                expected=f"numbers that are finite in {array.dtype}",
            )
        return array

    def texts(self, name: str) -> tuple[str, ...]:
        """The texts that were kept as one JSON text called ``name``."""
        texts = json.loads(str(self.read(name, "names as JSON text")))
        if not all(isinstance(text, str) for text in texts):
            raise ValueError("names that are no texts")
        return tuple(texts)

    @contextmanager
    def kept(self, writer: str, mark: str, version: int) -> Iterator[None]:
        """For reading what ``writer`` wrote, which left its ``mark`` and ``version``: whatever does
        not fit inside is a :class:`MotionFileError`."""
        found = self.read(mark, f"what {writer} wrote")
        try:
            if int(found) != version:
                raise ValueError(f"version {found}")
            yield
        except MotionFileError:
            raise
        except (TypeError, ValueError, RecursionError) as error:
            raise MotionFileError(
                self.path,
                f"fields that do not fit together ({error})",
                expected=f"what {writer} wrote",
                hint="make the file again",
            ) from error

    def _read(self, name: str) -> np.ndarray:
        with zipfile.ZipFile(self.path) as archive:
            info = archive.getinfo(f"{name}.npy")
            with archive.open(info) as file:
                version = np.lib.format.read_magic(file)
                header = {
                    (1, 0): np.lib.format.read_array_header_1_0,
                    (2, 0): np.lib.format.read_array_header_2_0,
                }.get(version)
                if header is None:
                    raise ValueError(f"format version {version}")
                shape, _, dtype = header(file)
            if dtype.hasobject:
                raise MotionFileError(
                    self.path,
                    f"pickled objects in {name!r}, which are never read",
                    expected="plain numbers or text",
                    hint="save the array again with a numeric dtype",
                )
            if math.prod(shape) * dtype.itemsize > info.file_size:
                raise ValueError(f"shape {shape} in {info.file_size} bytes")
            with archive.open(info) as file:
                array = np.lib.format.read_array(file, allow_pickle=False)
        if dtype.kind == "U" and dtype.itemsize:
            characters = array.astype(dtype.newbyteorder("=")).ravel().view(np.uint32)
            if characters.max(initial=0) > sys.maxunicode:  # NumPy makes a broken str of it
                raise ValueError("characters beyond Unicode")
        return array


def write_archive(file: IO[bytes], arrays: dict[str, np.ndarray], *, compress: bool) -> None:
    """Write arrays as an .npz file; the same arrays give the same bytes."""
    with zipfile.ZipFile(file, "w") as archive:
        for name, array in arrays.items():
            info = zipfile.ZipInfo(f"{name}.npy")
            info.compress_type = zipfile.ZIP_DEFLATED if compress else zipfile.ZIP_STORED
            member = io.BytesIO()
            np.lib.format.write_array(member, array, allow_pickle=False)
            archive.writestr(info, member.getbuffer(), compresslevel=1)
