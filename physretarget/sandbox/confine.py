"""What a process gives up for good, by the kernel: Landlock, seccomp, capabilities, limits.

Everything here is called in a young process with one thread, before it touches a stranger's
file, and cannot be undone afterwards. System calls are made through ctypes: no package is
needed that a machine may lack. On kernels without Landlock (before 5.13, or switched off) and
on processors other than x86-64 and ARM64 the respective wall is missing; ``available`` says so.
"""

from __future__ import annotations

import ctypes
import os
import platform
import resource
import signal
import struct
import sys
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from physretarget.sandbox.limits import Limits

_libc = ctypes.CDLL(None, use_errno=True)

_PR_SET_PDEATHSIG, _PR_SET_SECCOMP = 1, 22
_PR_CAPBSET_DROP, _PR_SET_NO_NEW_PRIVS = 24, 38


@dataclass(frozen=True)
class Walls:
    """Which of the kernel's walls stand on this machine.

    ``landlock`` is the version of its interface, 0 where there is none: 1 files, 4 also TCP,
    6 also signals and abstract sockets.
    """

    landlock: int
    seccomp: bool

    @property
    def missing(self) -> tuple[str, ...]:
        """What a job is not kept from on this machine, one phrase for each wall."""
        open_to = []
        if not self.landlock:
            open_to.append("reading and writing the user's files (no Landlock)")
        if not self.seccomp:
            open_to.append("the network and other programs (no seccomp)")
        return tuple(open_to)


@cache
def available() -> Walls:
    """What this machine offers; nothing is switched on by asking."""
    return Walls(landlock=_landlock_version(), seccomp=_seccomp_known())


def die_with_parent(parent: int) -> None:
    """End this process when the thread that started it ends; end now if it already has."""
    _prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def set_limits(limits: Limits) -> None:
    """Bound memory, processor time, files and core dumps, hard."""
    cpu = int(limits.cpu_seconds)
    for what, soft, hard in (
        (resource.RLIMIT_CORE, 1, 1),  # not 0: where a program takes the dumps, 1 alone means none
        (resource.RLIMIT_AS, limits.memory_bytes, limits.memory_bytes),
        # One second between the signal that explains itself and the one that only kills.
        (resource.RLIMIT_CPU, cpu, cpu + 1),
        (resource.RLIMIT_FSIZE, limits.file_bytes, limits.file_bytes),
        (resource.RLIMIT_NOFILE, limits.open_files, limits.open_files),
        (resource.RLIMIT_NPROC, limits.processes, limits.processes),
        (resource.RLIMIT_MEMLOCK, 0, 0),
        (resource.RLIMIT_MSGQUEUE, 0, 0),
    ):
        _, most = resource.getrlimit(what)
        if most != resource.RLIM_INFINITY:
            soft, hard = min(soft, most), min(hard, most)
        resource.setrlimit(what, (soft, hard))


def drop_privileges() -> None:
    """No capabilities (root in a container has some), and none by running another program."""
    _prctl(_PR_SET_NO_NEW_PRIVS, 1)
    for capability in range(64):
        if _libc.prctl(_PR_CAPBSET_DROP, capability, 0, 0, 0) != 0:
            break  # not ours to drop (no root), or the last one passed
    header = struct.pack("=Ii", 0x20080522, 0)  # _LINUX_CAPABILITY_VERSION_3, this process
    nothing = bytes(24)
    if _libc.capset(header, nothing) != 0:
        raise OSError(ctypes.get_errno(), "capset")


# ---- Landlock: files, TCP, signals ---------------------------------------------------------------

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # the same on every processor
_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1 << 0, 1 << 1, 1 << 2, 1 << 3
_REMOVE_DIR, _REMOVE_FILE, _MAKE_DIR, _MAKE_REG = 1 << 4, 1 << 5, 1 << 7, 1 << 8
_REFER, _TRUNCATE = 1 << 13, 1 << 14
_LAST_FILE_RIGHT = {1: 12, 2: 13, 3: 14, 4: 14}  # the highest bit known; 15 (ioctl) from 5 on
_OF_FILES = _READ_FILE | _WRITE_FILE | _EXECUTE | _TRUNCATE
READ = _READ_FILE | _READ_DIR
# No symbolic links, devices, sockets or pipes: only plain files and folders.
WRITE = READ | _WRITE_FILE | _REMOVE_DIR | _REMOVE_FILE | _MAKE_DIR | _MAKE_REG | _REFER | _TRUNCATE


def _landlock_version() -> int:
    if sys.platform != "linux":
        return 0
    return max(0, int(_libc.syscall(_CREATE_RULESET, None, ctypes.c_size_t(0), 1)))


def restrict_files(readable: Iterable[Path], writable: Iterable[Path]) -> None:
    """From now on open nothing else, run nothing, connect nowhere; no-op without Landlock.

    Paths that do not exist are skipped: they cannot be opened either.
    """
    version = available().landlock
    if version == 0:
        return
    files = (1 << (_LAST_FILE_RIGHT.get(version, 15) + 1)) - 1
    net = 0b11 if version >= 4 else 0  # bind and connect by TCP
    scoped = 0b11 if version >= 6 else 0  # abstract sockets, signals
    size = 8 if version < 4 else 16 if version < 6 else 24
    attributes = struct.pack("=QQQ", files, net, scoped)[:size]
    ruleset = _libc.syscall(_CREATE_RULESET, attributes, ctypes.c_size_t(size), 0)
    if ruleset < 0:
        raise OSError(ctypes.get_errno(), "landlock_create_ruleset")
    try:
        for paths, rights in ((readable, READ), (writable, WRITE)):
            for path in paths:
                _allow(ruleset, path, rights & files)
        _prctl(_PR_SET_NO_NEW_PRIVS, 1)
        if _libc.syscall(_RESTRICT_SELF, ruleset, 0) != 0:
            raise OSError(ctypes.get_errno(), "landlock_restrict_self")
    finally:
        os.close(ruleset)


def _allow(ruleset: int, path: Path, rights: int) -> None:
    try:
        handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
    except OSError:
        return
    try:
        if not path.is_dir():
            rights &= _OF_FILES
        rule = struct.pack("=Qi", rights, handle)
        if _libc.syscall(_ADD_RULE, ruleset, 1, rule, 0) != 0:
            raise OSError(ctypes.get_errno(), f"landlock_add_rule {path}")
    finally:
        os.close(handle)


def system_paths() -> tuple[Path, ...]:
    """What Python and its libraries read: themselves, the C library, time zones, fonts."""
    package = Path(__file__).resolve().parents[1]
    return (
        Path(sys.prefix),
        Path(sys.base_prefix),
        package,
        package.parent / "models",  # beside the package in a source tree
        *(Path(p) for p in sys.path if p.endswith(("site-packages", "dist-packages"))),
        *(Path(p) for p in ("/usr", "/lib", "/lib64", "/etc/ld.so.cache", "/etc/localtime")),
        *(Path(p) for p in ("/etc/fonts", "/dev/urandom", "/dev/zero", "/sys/devices/system/cpu")),
        *(Path(p) for p in ("/proc/self", "/proc/cpuinfo", "/proc/meminfo")),
        Path("/proc/sys/vm/overcommit_memory"),
    )


# ---- seccomp: no network, no programs, no other processes ----------------------------------------

# Processor: its audit number, and the numbers of the refused calls.
_PROCESSORS = {"x86_64": (0xC000003E, 0), "aarch64": (0xC00000B7, 1)}
_REFUSED = {  # name: (x86-64, ARM64), None where the processor has no such call
    "socket": (41, 198), "connect": (42, 203), "bind": (49, 200), "listen": (50, 201),
    "io_uring_setup": (425, 425), "execve": (59, 221), "execveat": (322, 281),
    "fork": (57, None), "vfork": (58, None), "ptrace": (101, 117), "kill": (62, 129),
    "tkill": (200, 130), "rt_sigqueueinfo": (129, 138), "rt_tgsigqueueinfo": (297, 240),
    "pidfd_send_signal": (424, 424), "pidfd_getfd": (438, 438), "process_vm_readv": (310, 270),
    "process_vm_writev": (311, 271), "bpf": (321, 280), "perf_event_open": (298, 241),
    "userfaultfd": (323, 282), "add_key": (248, 217), "request_key": (249, 218),
    "keyctl": (250, 219), "mount": (165, 40), "umount2": (166, 39), "unshare": (272, 97),
    "setns": (308, 268), "pivot_root": (155, 41), "chroot": (161, 51), "fsopen": (430, 430),
    "open_tree": (428, 428), "move_mount": (429, 429), "mount_setattr": (442, 442),
    "open_by_handle_at": (304, 265), "memfd_create": (319, 279), "memfd_secret": (447, 447),
    "shmget": (29, 194), "mq_open": (240, 180), "personality": (135, 92),
    # Landlock does not see these, and by path they would reach any file of the same user.
    "chmod": (90, None), "fchmodat": (268, 53), "fchmodat2": (452, 452), "chown": (92, None),
    "lchown": (94, None), "fchownat": (260, 54), "setxattr": (188, 5), "lsetxattr": (189, 6),
    "setxattrat": (463, 463), "removexattr": (197, 14), "lremovexattr": (198, 15),
    "utime": (132, None), "utimes": (235, None), "futimesat": (261, None),
    "utimensat": (280, 88),
}  # fmt: skip
_CLONE, _CLONE3, _TGKILL, _PRLIMIT = (56, 220), (435, 435), (234, 131), (302, 261)
_CLONE_THREAD = 0x10000
_ALLOW, _EPERM, _ENOSYS = 0x7FFF0000, 0x00050000 | 1, 0x00050000 | 38
_LOAD, _EQUAL, _AT_LEAST, _BITS, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06
_NUMBER, _ARCH, _ARGUMENT = 0, 4, 16  # offsets in struct seccomp_data (little endian)


def _seccomp_known() -> bool:
    if sys.platform != "linux" or platform.machine() not in _PROCESSORS:
        return False
    # Asks for an impossible filter: EFAULT from a kernel that has seccomp, EINVAL from others.
    _libc.prctl(_PR_SET_SECCOMP, 2, None, 0, 0)
    return ctypes.get_errno() == 14


def restrict_calls() -> None:
    """Refuse the calls of ``_REFUSED``, new processes (not threads) and signals to others."""
    if not available().seccomp:
        return
    program = b"".join(struct.pack("=HBBI", *line) for line in _filter(os.getpid()))
    buffer = ctypes.create_string_buffer(program, len(program))
    head = struct.pack("@HP", len(program) // 8, ctypes.addressof(buffer))
    _prctl(_PR_SET_NO_NEW_PRIVS, 1)
    if _libc.prctl(_PR_SET_SECCOMP, 2, head, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), "seccomp")


def _filter(pid: int) -> list[tuple[int, int, int, int]]:
    """The filter: (operation, jump if true, jump if false, operand) for each line."""
    arch, column = _PROCESSORS[platform.machine()]
    lines = [
        (_LOAD, 0, 0, _ARCH),
        (_EQUAL, 1, 0, arch),
        (_RETURN, 0, 0, _EPERM),
        (_LOAD, 0, 0, _NUMBER),
        (_AT_LEAST, 0, 1, 0x40000000),  # the x32 interface: other numbers for the same calls
        (_RETURN, 0, 0, _EPERM),
    ]
    for number in (pair[column] for pair in _REFUSED.values()):
        if number is not None:
            lines += [(_EQUAL, 0, 1, number), (_RETURN, 0, 0, _EPERM)]
    # The C library falls back from clone3, whose flags lie out of a filter's sight, to clone.
    lines += [(_EQUAL, 0, 1, _CLONE3[column]), (_RETURN, 0, 0, _ENOSYS)]
    for number, operation, operand in (
        (_CLONE[column], _BITS, _CLONE_THREAD),
        (_TGKILL[column], _EQUAL, pid),  # abort() signals its own process
        (_PRLIMIT[column], _EQUAL, 0),
    ):
        lines += [
            (_EQUAL, 0, 4, number),
            (_LOAD, 0, 0, _ARGUMENT),
            (operation, 0, 1, operand),
            (_RETURN, 0, 0, _ALLOW),
            (_RETURN, 0, 0, _EPERM),
        ]
    return [*lines, (_RETURN, 0, 0, _ALLOW)]


def _prctl(option: int, value: int) -> None:
    if _libc.prctl(option, ctypes.c_ulong(value), 0, 0, 0) != 0:
        raise OSError(ctypes.get_errno(), f"prctl {option}")
