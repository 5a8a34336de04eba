"""Many clips: a corpus as a value, on disk, as batches for training, in numbers; and one function
over all files of a folder or a bucket, on one machine or many.

:class:`Corpus` is a sequence of motions of one skeleton at one rate that are read when they are
asked for; :class:`Batches` and :class:`WindowSource` are what training loops take of it,
:class:`CorpusStatistics` what is usual in it. :func:`map` sends files through a function. What runs
on workers is dask's, an extra: ``pip install 'jaxmotion[distributed]'``; nothing of it is imported
before it is asked for. Other modules of this room are the library's own.
"""

from jaxmotion.corpus.corpus import Corpus
from jaxmotion.corpus.local import local_client
from jaxmotion.corpus.mapping import Mapped, map
from jaxmotion.corpus.statistics import CorpusStatistics
from jaxmotion.corpus.windows import Batches, WindowSource

__all__ = [
    "Batches",
    "Corpus",
    "CorpusStatistics",
    "Mapped",
    "WindowSource",
    "local_client",
    "map",
]
