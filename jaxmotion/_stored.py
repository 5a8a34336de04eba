"""Many clips that are read when they are asked for: what a corpus is to the rooms below it."""

from abc import abstractmethod
from collections.abc import Sequence

import numpy as np

from jaxmotion.motion import Motion
from jaxmotion.skeleton import Skeleton


class StoredClips(Sequence[Motion]):
    """Clips of one skeleton, rate and dtype, each read when it is asked for. Pickled, they take
    along where the clips are, and none of them."""

    @property
    @abstractmethod
    def skeleton(self) -> Skeleton:
        """Of all clips."""

    @property
    @abstractmethod
    def dtype(self) -> np.dtype:
        """Of all clips."""

    @property
    @abstractmethod
    def lengths(self) -> np.ndarray:
        """Frames of each clip, i64[C]."""

    @abstractmethod
    def digest(self) -> str:
        """A text that no other clips have, in another process neither."""
