"""Many clips at once: a corpus as a value, on disk, as batches for training, in numbers.

:class:`Corpus` is a sequence of motions of one skeleton at one rate that are read when they are
asked for; :class:`Batches` and :class:`WindowSource` are what training loops take of it,
:class:`CorpusStatistics` what is usual in it. Other names of this room are the library's own.
"""

from jaxmotion.corpus.corpus import Corpus
from jaxmotion.corpus.statistics import CorpusStatistics
from jaxmotion.corpus.windows import Batches, WindowSource

__all__ = ["Batches", "Corpus", "CorpusStatistics", "WindowSource"]
