"""Ctrl-C and SIGTERM: acknowledged at once, also while the main thread is in a library; never lost.

A thread hears of it as the system does. The first one raises KeyboardInterrupt, or where a block finishes something
first, is noted; if the block has not ended some seconds later, it is raised again. A second one raises too, and if that
does not end the block at once, ends the process where it stands: all files are written whole or not at all.
"""

from __future__ import annotations

import select
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from types import FrameType

#: Seconds in which running work may be finished after Ctrl-C.
GRACE = 2.0
#: Seconds after the first Ctrl-C until it is raised in a block that has neither finished its work nor ended.
PATIENCE = GRACE + 0.5
#: Seconds after which a Ctrl-C that has not ended the block is acknowledged.
SOON = 0.3
#: Seconds after a second Ctrl-C in which the block may end.
LAST = 1.0
_NOTHING = "ending the present step"
#: Signals by their numbers, as a user knows them.
_NAMES: dict[int, str] = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}


class _Listener:
    """Thread that hears of Ctrl-C during a block, and the handler of the main thread.

    Attributes
    ----------
    signals
        What is listened to.
    came
        Those that came.
    finishing
        What is finished before the block ends, innermost last, and the events that note a Ctrl-C.
    """

    def __init__(
        self,
        signals: list[signal.Signals],
        came: set[int],
        say: Callable[[str], None],
        end: Callable[[], None],
    ) -> None:
        self.signals, self.came = signals, came
        self._say, self._end = say, end
        self.finishing: list[tuple[str, threading.Event]] = []
        self._heard = self._taken = 0
        self._late, self._own = False, 0
        self._near, self._far = socket.socketpair()
        self._near.setblocking(False)
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def open(self) -> None:
        """Begin to listen; only in the main thread."""
        self._wakeup = signal.set_wakeup_fd(self._near.fileno(), warn_on_full_buffer=False)
        self._before = [signal.signal(number, self._take) for number in self.signals]
        self._thread.start()

    def close(self) -> None:
        """Put everything back as it was."""
        for number, before in zip(self.signals, self._before, strict=True):
            signal.signal(number, before)
        signal.set_wakeup_fd(self._wakeup)
        self._near.close()  # which ends the thread
        self._thread.join(LAST)
        self._far.close()

    def _take(self, number: int, frame: FrameType | None) -> None:
        self.came.add(number)
        self._taken += 1
        if self.finishing and not self._late and max(self._taken, self._heard) == 1:
            self.finishing[-1][1].set()
            return
        raise KeyboardInterrupt

    def _listen(self) -> None:
        #: Times at which something is to be done, the next one first.
        due: list[tuple[float, Callable[[], None]]] = []
        while True:
            wait = max(0.0, due[0][0] - time.monotonic()) if due else None
            if not select.select([self._far], [], [], wait)[0]:
                due.pop(0)[1]()
            elif not (news := self._far.recv(64)):
                return
            elif self._own:
                self._own -= 1
            elif heard := {number for number in self.signals if number in news}:
                self.came |= heard
                now = time.monotonic()
                self._heard += 1
                if self._heard == 1:
                    soon = now if self.finishing else now + SOON
                    due = [(soon, self._acknowledge), (now + PATIENCE, self._again)]
                else:
                    due = [(now + LAST, self._end)]

    def _acknowledge(self) -> None:
        what = self.finishing[-1][0] if self.finishing else _NOTHING
        with suppress(OSError, ValueError):  # nobody listens
            name = _NAMES[max(self.came, default=signal.SIGINT)]
            self._say(f"{name}: {what} first; {name} again ends at once")

    def _again(self) -> None:
        # Elsewhere it has been raised, and the block may be cleaning up.
        if self.finishing:
            self._late, self._own = True, 1
            if sys.platform == "win32":
                signal.raise_signal(self.signals[0])
            else:  # which also wakes the main thread
                signal.pthread_kill(threading.main_thread().ident or 0, self.signals[0])


_active: list[_Listener] = []


@contextmanager
def listening(
    say: Callable[[str], None], end: Callable[[], None] = lambda: None, came: set[int] | None = None
) -> Iterator[None]:
    """Acknowledge Ctrl-C during the block with one line to ``say``; call ``end`` if a second one does not end it.

    With ``came``, SIGTERM is taken like Ctrl-C, and the signals that came are put into it. Outside the main thread,
    where signals do not arrive, within another such block, and for signals that are ignored nothing changes.
    """
    main = threading.current_thread() is threading.main_thread()
    signals = [] if signal.getsignal(signal.SIGINT) in (signal.SIG_IGN, None) else [signal.SIGINT]
    if came is not None and signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signals.append(signal.SIGTERM)
    if not main or _active or not signals:
        yield
        return
    listener = _Listener(signals, set() if came is None else came, say, end)
    listener.open()
    _active.append(listener)
    try:
        yield
    finally:
        _active.remove(listener)
        listener.close()


@contextmanager
def finishing(what: str) -> Iterator[threading.Event]:
    """Note the first Ctrl-C of the block, which ``what`` says it finishes, in the event; a second one raises."""
    noted = threading.Event()
    with listening(lambda text: None):
        if not _active or threading.current_thread() is not threading.main_thread():
            yield noted
            return
        entry = (what, noted)
        _active[0].finishing.append(entry)
        try:
            yield noted
        finally:
            _active[0].finishing.remove(entry)
