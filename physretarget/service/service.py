"""A running service: what the routes are thin over."""

from __future__ import annotations

import asyncio
import logging
import threading
import time
from collections.abc import Iterable, Mapping
from typing import Any

from physretarget.errors import PhysretargetError, UsageError
from physretarget.sandbox.confine import available
from physretarget.sandbox.pool import Pool
from physretarget.service.builtin import builtins
from physretarget.service.checks import Checks
from physretarget.service.errors import ApiError
from physretarget.service.home import Home, remove
from physretarget.service.metrics import Metrics
from physretarget.service.settings import Settings
from physretarget.service.state import Trouble, free_bytes, troubles
from physretarget.service.supervisor import Supervisor
from physretarget.service.tokens import Tickets, Tokens
from physretarget.service.uploads import Upload
from physretarget.suite.queue import JobRecord, NewJob, Queue
from physretarget.suite.registry import ClipRecord, Registry
from physretarget.suite.store import Store

_CHUNK = 500  # contents per question to the database
log = logging.getLogger("physretarget.service")


class Service:
    """Everything that lives as long as the server; ``pool`` starts the children, its own if None.

    Raises:
        InputError: the data folder or the history cannot be used.
        UsageError: another server holds the folder, or tokens are required and there are none.
    """

    def __init__(self, settings: Settings, pool: Pool | None = None) -> None:
        self.settings = settings
        self.home = Home(settings.data)
        self.home.lock()
        self.store = Store(settings.history or self.home.history)
        self.queue = Queue(self.store, self.home.id)
        self.registry = Registry(self.store, self.home.id)
        self.tokens = Tokens(self.registry, required=settings.require_tokens)
        if settings.require_tokens and not self.tokens.usable:
            raise UsageError(
                "to be reached from beyond this machine a token is needed: "
                "'physretarget token create --scope submit --name NAME' makes one."
            )
        self.comparing = threading.Lock()
        self.tickets = Tickets()
        self.metrics = Metrics()
        self._owns_pool = pool is None
        self.pool = pool or Pool(("physretarget.service.tasks",))
        self.checks = Checks(self.home, self.pool, settings.limits, settings.check_seconds)
        self.supervisor = Supervisor(
            self.queue, self.home, self.pool, limits=settings.limits, workers=settings.workers,
            lease=settings.lease, heartbeat=settings.heartbeat, metrics=self.metrics,
            released=self.release, full=self.full,
        )  # fmt: skip
        self.counts: Mapping[str, int] = {}
        self.reachable = True
        self.looked = time.monotonic()
        self.oldest: str | None = None
        self.locked = self.tokens.needed
        self.stopping = False
        self.streams = 0
        self._builtin: dict[str, dict[str, Any]] = {}
        self._blobs = threading.Lock()

    def start(self) -> None:
        """Take up what a server that died left, then work."""
        for what in available().missing:
            log.warning("this machine's kernel does not keep jobs from %s", what)
        self.home.sweep()
        self.queue.recover()
        self._collect()
        self.counts = self.queue.counts()
        self.supervisor.start()
        threading.Thread(target=self._warm_up, name="warm-up", daemon=True).start()

    def _warm_up(self) -> None:
        """Import what jobs need before the first one comes."""
        try:
            self.pool.start()
        except PhysretargetError as error:
            log.error("%s", error)

    def look(self) -> None:
        """See how many jobs there are and whether the database answers."""
        try:
            self.counts, self.locked = self.queue.counts(), self.tokens.needed
            self.oldest = self.queue.oldest()
            self.reachable, self.looked = True, time.monotonic()
        except PhysretargetError as error:
            if self.reachable:
                log.error("the history cannot be reached: %s", error)
            self.reachable = False

    @property
    def free(self) -> int:
        """Free disk, bytes."""
        return free_bytes(self.home.folder)

    def full(self) -> bool:
        """Whether the disk's reserve is gone: nothing is taken in then, and no job begins."""
        return self.free < self.settings.reserve

    def troubles(self) -> list[Trouble]:
        """Why it cannot take or do work, if so."""
        return troubles(
            free=self.free, reserve=self.settings.reserve, looked=self.looked,
            reachable=self.reachable, alive=self.supervisor.workers, wanted=self.settings.workers,
        )  # fmt: skip

    def stop(self) -> None:
        """Give running jobs back and let go of everything."""
        self.stopping = True
        self.supervisor.stop()
        self.checks.close()
        if self._owns_pool:
            self.pool.close()
        self.store.__exit__(None, None, None)
        self.home.unlock()

    # ---- contents ------------------------------------------------------------------------------

    def keep(self, upload: Upload) -> None:
        """Give an upload its place among the blobs; for who holds the lock on them."""
        place = self.home.blob(upload.sha256)
        # The same content in another file would be another file to a child that was just
        # allowed to read this one.
        if place.exists():
            upload.path.unlink()
        else:
            upload.path.replace(place)
        self.metrics.upload_bytes.inc(upload.bytes)

    def add_clip(self, upload: Upload, owner: str | None = None) -> ClipRecord:
        """Register an uploaded clip or capture of an owner's."""
        with self._blobs:
            self.keep(upload)
            return self.registry.add_clip(upload.name, upload.sha256, upload.bytes, owner)

    def submit(self, job: NewJob, uploads: Iterable[Upload]) -> tuple[JobRecord, bool]:
        """Queue a job with its uploads; see :meth:`Queue.submit`.

        Raises:
            ApiError: 404 a clip that it names was deleted meanwhile.
        """
        with self._blobs:
            for upload in {upload.sha256: upload for upload in uploads}.values():
                self.keep(upload)
            for sha256 in job.inputs["blobs"]:
                if not self.home.blob(sha256).exists():
                    raise ApiError(404, "The clip has just been deleted.", field="clip_id")
            made, new = self.queue.submit(job)
        if new:
            self.metrics.submitted.labels(job.kind).inc()
            self.supervisor.notify()
        return made, new

    def delete_clip(self, id: str, owner: str | None = None) -> bool:
        """Forget a clip, and its content unless it is needed still."""
        found = self.registry.clip(id, owner)
        if found is None or not self.registry.delete_clip(id, owner):
            return False
        self.discard((found.sha256,))
        return True

    def delete_job(self, id: str, owner: str | None = None) -> bool:
        """Forget a job that has ended, and its results."""
        if not self.queue.delete(id, owner):
            return False
        remove(self.home.job(id))
        return True

    def delete_model(self, id: str, owner: str | None = None) -> bool:
        """Forget a model; its files stay while a job needs them, until the next start."""
        if not self.registry.delete_model(id, owner):
            return False
        if id not in self.queue.needed_models():
            remove(self.home.models / id)
        return True

    def release(self, job: JobRecord) -> None:
        """Remove what was there for this job only."""
        self.discard(job.inputs.get("blobs", ()))
        model = job.inputs.get("model", {})
        if model.get("once"):
            remove(self.home.models / model["folder"])

    def discard(self, sha256s: Iterable[str]) -> None:
        """Remove contents that neither a registered clip nor a job to come needs."""
        with self._blobs:
            asked = set(sha256s)
            for sha256 in asked - self.queue.needed_blobs(asked):
                if not self.registry.has_content(sha256):
                    self.home.blob(sha256).unlink(missing_ok=True)

    def _collect(self) -> None:
        """Remove contents and models that a server which died left without an owner."""
        names = sorted(path.name for path in self.home.blobs.iterdir())
        for start in range(0, len(names), _CHUNK):
            self.discard(names[start : start + _CHUNK])
        for folder in self.home.models.iterdir():
            if (
                self.registry.model(folder.name) is None
                and folder.name not in self.queue.needed_models()
            ):
                remove(folder)

    # ---- built-in models -----------------------------------------------------------------------

    async def builtin_facts(self) -> dict[str, dict[str, Any]]:
        """Facts of the built-in models, found out once, when first asked for."""
        for name, model in builtins().items():
            if name not in self._builtin:
                facts, files = await self.checks.model(model.path, f"{name}.xml", "")
                await asyncio.to_thread(remove, files)
                self._builtin[name] = facts
        return self._builtin
