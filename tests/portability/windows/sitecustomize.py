"""Python that looks like that of Windows to porocore and its plugins, for every process with this folder on PYTHONPATH.

Not a copy of Windows: paths keep their slashes, and libraries of others, which run there, see the true system. What
porocore sees: no modules, functions and signals of POSIX alone; names of files that Windows refuses; no removal and no
replacement of a file that anybody has open; text in Windows-1252 with two characters at the end of a line where a file
or a stream does not say otherwise; processes that are spawned.
"""

import builtins
import io
import os
import signal
import stat
import subprocess
import sys
import types
from pathlib import Path

HERE = str(Path(__file__).parent)
OURS = ("porocore", "porocore_")
#: Parts of the standard library that stand between porocore and what is refused.
BETWEEN = {
    "pathlib",
    "shutil",
    "contextlib",
    "tempfile",
    "subprocess",
    "weakref",
    "os",
    "io",
    "codecs",
    __name__,
}
MODULES = {
    *("fcntl", "resource", "pwd", "grp", "spwd", "termios", "tty", "pty", "posix", "syslog", "crypt", "nis"),
    *("curses", "readline"),
}
ABSENT = {
    "os": {
        *("fork", "forkpty", "wait", "wait3", "wait4", "waitid", "killpg", "getpgid", "getpgrp", "setpgid", "setsid"),
        *("getsid", "getuid", "geteuid", "getgid", "getegid", "getgroups", "setuid", "setgid", "getpriority", "nice"),
        *("sched_getaffinity", "sched_setaffinity", "sched_yield", "getloadavg", "sysconf", "confstr", "uname"),
        *("mkfifo", "mknod", "chown", "lchown", "fchown", "fchmod", "chroot", "statvfs", "fstatvfs", "pathconf"),
        *("pread", "pwrite", "readv", "writev", "sendfile", "posix_fallocate", "posix_spawn", "openpty", "ctermid"),
        *("O_NOFOLLOW", "O_CLOEXEC", "O_NONBLOCK", "O_DIRECTORY", "O_SYNC", "O_TMPFILE"),
        *("WIFSIGNALED", "WTERMSIG", "WIFEXITED", "WEXITSTATUS", "WNOHANG", "register_at_fork", "getxattr"),
    },
    "signal": {
        *("pthread_sigmask", "pthread_kill", "setitimer", "getitimer", "alarm", "pause", "sigwait", "sigpending"),
        *("siginterrupt", "SIGKILL", "SIGALRM", "SIGHUP", "SIGPROF", "SIGUSR1", "SIGUSR2", "SIGCHLD", "SIGPIPE"),
        *("SIGQUIT", "SIGSTOP", "SIGCONT", "SIGTSTP", "SIGVTALRM", "SIG_BLOCK", "SIG_UNBLOCK", "SIG_SETMASK"),
        *("ITIMER_REAL", "ITIMER_PROF", "ITIMER_VIRTUAL", "ItimerError"),
    },
    "time": {"tzset", "clock_gettime", "CLOCK_MONOTONIC"},
    "sys": {"getdlopenflags", "setdlopenflags", "abiflags"},
}  # fmt: skip
RESERVED = {"CON", "PRN", "AUX", "NUL", *(f"{name}{n}" for name in ("COM", "LPT") for n in range(1, 10))}


def is_ours(name):
    return name == OURS[0] or name.startswith((OURS[0] + ".", OURS[1]))


def caller():
    """The first frame outside this file and what stands between."""
    frame = sys._getframe(1)
    while frame is not None:
        name = frame.f_globals.get("__name__", "")
        if name.partition(".")[0] not in BETWEEN:
            return frame
        # POSIX removes a temporary file while it is open; Windows lets the system remove it.
        if name == "tempfile" and frame.f_code.co_name in ("TemporaryFile", "NamedTemporaryFile"):
            return None
        frame = frame.f_back
    return None


def called_by_porocore():
    frame = caller()
    return frame is not None and is_ours(frame.f_globals.get("__name__", ""))


class Reduced(types.ModuleType):
    """A module without what Windows lacks."""

    def __init__(self, true, absent, **other):
        super().__init__(true.__name__)
        object.__getattribute__(self, "__dict__").update(_true=true, _absent=absent, _other=other)

    def __getattribute__(self, name):
        inside = object.__getattribute__(self, "__dict__")
        if name in inside["_absent"]:
            raise AttributeError(f"Windows has no {inside['_true'].__name__}.{name}", name=name)
        return inside["_other"][name] if name in inside["_other"] else getattr(inside["_true"], name)

    def __setattr__(self, name, value):
        setattr(object.__getattribute__(self, "__dict__")["_true"], name, value)

    def __delattr__(self, name):
        delattr(object.__getattribute__(self, "__dict__")["_true"], name)


def kill(pid, number):
    """On Windows every signal but those of the console ends a process, 0 as well."""
    os.kill(pid, signal.SIGKILL)


def take_signal(number, handler):
    if number not in (
        signal.SIGABRT,
        signal.SIGFPE,
        signal.SIGILL,
        signal.SIGINT,
        signal.SIGSEGV,
        signal.SIGTERM,
    ):
        raise ValueError("invalid signal value")
    return signal.signal(number, handler)


import time  # noqa: E402

REDUCED = {
    "os": Reduced(os, ABSENT["os"], name="nt", linesep="\r\n", kill=kill),
    "signal": Reduced(signal, ABSENT["signal"], signal=take_signal),
    "sys": Reduced(sys, ABSENT["sys"], platform="win32"),
    "time": Reduced(time, ABSENT["time"]),
}
true_import = builtins.__import__


def import_as_on_windows(name, globals=None, locals=None, fromlist=(), level=0):
    if level == 0 and globals is not None and is_ours(globals.get("__name__") or ""):
        if name.partition(".")[0] in MODULES:
            raise ModuleNotFoundError(f"No module named '{name}' on Windows", name=name)
        if name in REDUCED:
            true_import(name, globals, locals, fromlist, level)
            return REDUCED[name]
    return true_import(name, globals, locals, fromlist, level)


builtins.__import__ = import_as_on_windows

true_open = io.open


def open_as_on_windows(
    file, mode="r", buffering=-1, encoding=None, errors=None, newline=None, *more, **others
):
    if "b" not in mode and called_by_porocore():
        encoding = "cp1252" if encoding in (None, "locale") else encoding
        newline = "\r\n" if newline is None and set(mode) & set("wax+") else newline
    return true_open(file, mode, buffering, encoding, errors, newline, *more, **others)


io.open = builtins.open = open_as_on_windows


def check_name(path):
    """Windows has no file of such a name."""
    for part in Path(os.fsdecode(path)).parts:
        stem = part.partition(".")[0].rstrip().upper()
        if part not in ("/", ".", "..") and (
            set(part) & set('<>:"|?*\\') or min(part) < " " or part[-1] in ". " or stem in RESERVED
        ):
            raise OSError(22, f"Windows has no file named {part!r}", os.fsdecode(path))


def check_case(path):
    """Windows takes names that differ in capitals for one."""
    above, name = os.path.split(os.path.abspath(os.fsdecode(path)))
    if os.path.isdir(above):
        for other in os.listdir(above):
            if other != name and other.casefold() == name.casefold():
                raise OSError(17, f"on Windows {name!r} would be {other!r}", os.fsdecode(path))


def audit(event, args):
    if event == "open" and isinstance(args[0], str | bytes):
        path, mode, flags = args
        making = bool(flags & os.O_CREAT) if mode is None else bool(set(mode) & set("wax"))
        place = os.fsdecode(path)
        above = sys._getframe().f_back
        if (
            place == os.devnull
            or above is None
            or above.f_code is holders.__code__
            or not called_by_porocore()
        ):
            return
        if place.startswith(("/proc/", "/sys/", "/dev/")):
            raise FileNotFoundError(2, "Windows has no such file", place)
        if making:
            check_name(path)
            check_case(path)
    elif event in ("os.mkdir", "os.rename") and called_by_porocore():
        check_name(args[event == "os.rename"])
        check_case(args[event == "os.rename"])


sys.addaudithook(audit)


def holders(path):
    """Processes that have a file open, or this one in its memory."""
    try:
        found = os.stat(path, follow_symlinks=False)
    except OSError:
        return []
    if not stat.S_ISREG(found.st_mode):
        return []
    place, holding = os.path.realpath(path), []
    for process in filter(str.isdigit, os.listdir("/proc")):
        folder = f"/proc/{process}/fd"
        try:
            opened = os.listdir(folder)
        except OSError:
            continue
        for number in opened:
            try:
                if os.readlink(f"{folder}/{number}") == place:
                    holding.append(int(process))
            except OSError:
                continue
    with true_open("/proc/self/maps", encoding="utf-8", errors="replace") as maps:
        return holding + [os.getpid() for line in maps if line.rstrip("\n").endswith(f" {place}")]


def refuse_if_open(*paths):
    if called_by_porocore():
        for path in paths:
            if held := holders(path):
                raise PermissionError(13, f"Windows: processes {held} have the file open", os.fsdecode(path))


def guarded(function, count):
    def as_on_windows(*paths, **others):
        if not any(others.values()):
            refuse_if_open(*paths[:count])
        return function(*paths, **others)

    return as_on_windows


for _name, _count in (("replace", 2), ("rename", 2), ("unlink", 1), ("remove", 1)):
    setattr(os, _name, guarded(getattr(os, _name), _count))

true_start = subprocess.Popen.__init__


def start_as_on_windows(self, args, *more, **options):
    """A process with -I ignores PYTHONPATH, and this folder with it."""
    if options.get("preexec_fn") is not None and called_by_porocore():
        raise ValueError("preexec_fn is not supported on Windows platforms")
    if isinstance(args, list | tuple) and "-I" in args and args[0] == sys.executable:
        args = list(args)
        place = args.index("-c") + 1
        # The system may have a module of this name.
        mine = f"import sys; sys.modules.pop('sitecustomize', None); sys.path.insert(0, {HERE!r}); import sitecustomize"
        args[place] = f"{mine}\n{args[place]}"
    return true_start(self, args, *more, **options)


subprocess.Popen.__init__ = start_as_on_windows

import multiprocessing  # noqa: E402

multiprocessing.set_start_method("spawn")

for _stream in (sys.stdout, sys.stderr):
    if _stream is not None:
        _stream.reconfigure(newline="\r\n")
