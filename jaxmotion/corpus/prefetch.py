"""What an iterator gives, made in a thread while the one before is in use.

The thread ends when the iterator does, when nobody holds it any longer (a ``break``), when it is
closed, or when something is raised on either side; what is raised in the thread is raised where the
item would have been.
"""

import queue
import threading
from collections.abc import Callable, Iterator
from typing import Any, TypeVar

Item = TypeVar("Item")
_DONE = object()


def prefetched(make: Callable[[], Iterator[Item]], ahead: int) -> Iterator[Item]:
    """The items of ``make()``, up to ``ahead`` of them made before they are asked for; 0: none, and
    no thread."""
    if ahead < 1:
        yield from make()
        return
    ready: queue.Queue[tuple[Any, BaseException | None]] = queue.Queue(ahead)
    left = threading.Event()

    def work() -> None:
        try:
            for item in make():
                ready.put((item, None))
                if left.is_set():
                    return
            ready.put((_DONE, None))
        except BaseException as error:  # any, for the other side
            ready.put((_DONE, error))

    thread = threading.Thread(target=work, name="jaxmotion-corpus-prefetch", daemon=True)
    thread.start()
    try:
        while True:
            item, error = ready.get()
            if error is not None:
                raise error
            if item is _DONE:
                return
            yield item
    finally:
        left.set()
        while thread.is_alive():
            try:  # room for the item that the thread has made, so that it sees that we left
                ready.get_nowait()
            except queue.Empty:
                thread.join(0.01)
