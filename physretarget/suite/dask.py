"""The same run on a Dask cluster: inputs travel as bytes, named by their content.

The only file that imports the distributed engine. Workers need the package and nothing else: no
shared disk, no copy of the library. A worker that dies costs its running jobs a retry.
"""

from __future__ import annotations

import atexit
import hashlib
import shutil
import tempfile
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from typing import Any

from physretarget.errors import InputError, MissingExtraError
from physretarget.files import write_file
from physretarget.suite.job import Job, Outcome
from physretarget.suite.run import Execute, one_thread

try:
    from distributed import Client, KilledWorker, LocalCluster, as_completed
except ImportError as error:
    raise MissingExtraError("Dask", extra="dask", purpose="a suite on a cluster") from error

Files = dict[str, bytes]
# Jobs handed out per worker core: enough that none waits, few enough that inputs of a large
# library do not pile up in the scheduler's memory.
_AHEAD = 3
PATIENCE_S = 30
_LOST = (KilledWorker, OSError)


@contextmanager
def distributed(scheduler: str, workers: int) -> Iterator[Execute]:
    """Connect to a scheduler, or start a cluster on this machine if it is called "local".

    Raises:
        InputError: nobody answers at the address.
    """
    if scheduler == "local":
        # Nothing of ours needs the dashboard, and a port less is a port less.
        with (
            LocalCluster(  # type: ignore[no-untyped-call]
                n_workers=workers, threads_per_worker=1, dashboard_address=None,
                host="127.0.0.1",
            ) as cluster,
            Client(cluster) as client,  # type: ignore[no-untyped-call]
        ):  # fmt: skip
            yield on(client)
        return
    try:
        client = Client(scheduler, timeout=PATIENCE_S)  # type: ignore[no-untyped-call]
    except (OSError, ValueError, TimeoutError) as error:
        raise InputError(f"no Dask scheduler answers at {scheduler!r}: {error}.") from error
    with client:
        yield on(client)


def on(client: Any) -> Execute:
    """Do jobs on the cluster of a client."""

    def execute(jobs: Sequence[Job]) -> Iterator[Outcome]:
        shared = _Shared(client)
        waiting = deque(jobs)
        running: dict[Any, Job] = {}
        pool: Any = as_completed()  # type: ignore[no-untyped-call]

        def hand_out() -> None:
            cores = sum(client.nthreads().values()) or 1
            while waiting and len(running) < _AHEAD * cores:
                job = waiting.popleft()
                future = _submit(client, job, shared)
                running[future] = job
                pool.add(future)

        hand_out()
        for future in pool:
            job = running.pop(future)
            yield _outcome(future, job)
            future.release()
            hand_out()

    return execute


class _Shared:
    """Files that many jobs need (models, key poses, configs), sent to the cluster once."""

    def __init__(self, client: Any) -> None:
        self.client = client
        self.sent: dict[str, Any] = {}

    def put(self, path: Path) -> Any:
        content = path.read_bytes()
        name = f"suite-file-{hashlib.sha256(content).hexdigest()}"
        if name not in self.sent:
            # Not scattered: data that lives on one worker dies with it, a task can be redone.
            self.sent[name] = self.client.submit(_as_is, content, key=name)
        return self.sent[name]


def _as_is(content: bytes) -> bytes:
    return content


def _submit(client: Any, job: Job, shared: _Shared) -> Any:
    root = Path(job.root)
    own = job.inputs["clip"]
    try:
        clip = (root / own).read_bytes()
    except OSError:
        clip = None  # the worker says so, as it would here
    others = [name for name in job.files if name != own]
    return client.submit(
        _there, job, clip, others, [shared.put(root / name) for name in others],
        key=f"suite-job-{job.address}", retries=2, pure=True,
    )  # fmt: skip


def _there(job: Job, clip: bytes | None, names: list[str], contents: list[bytes]) -> Outcome:
    """On the worker: put the inputs where the job expects them, by content, and do it."""
    one_thread()
    files = dict(zip(names, contents, strict=True))
    # One folder per set of shared files: the models in it are loaded once per worker.
    shared = _folder() / _digest(files)
    try:
        for name, content in files.items():
            _place(shared / name, content)
        if clip is not None:
            _place(shared / job.inputs["clip"], clip)
        from physretarget.suite.work import perform

        return perform(job, str(shared))
    finally:
        if clip is not None:
            (shared / job.inputs["clip"]).unlink(missing_ok=True)


def _digest(files: Files) -> str:
    digest = hashlib.sha256()
    for name, content in sorted(files.items()):
        digest.update(name.encode() + b"\0" + hashlib.sha256(content).digest())
    return digest.hexdigest()[:24]


def _place(target: Path, content: bytes) -> None:
    if target.is_file() and target.stat().st_size == len(content):
        return
    target.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    write_file(target, content)


def _outcome(future: Any, job: Job) -> Outcome:
    error = future.exception()
    if error is None:
        outcome: Outcome = future.result()
        return outcome
    if isinstance(error, _LOST):
        message = "the workers that judged it died, again and again (killed, or out of memory)."
    else:
        message = f"the cluster failed: {type(error).__name__}: {error}"
    return Outcome(address=job.address, status="errored", message=message, transient=True)


@cache
def _folder() -> Path:
    """This worker's own folder, gone when the worker ends."""
    folder = Path(tempfile.mkdtemp(prefix="physretarget-suite-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
