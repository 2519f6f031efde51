"""What Prometheus is told. A registry of its own, so that two services in a process don't mix."""

from __future__ import annotations

from prometheus_client import CollectorRegistry, Counter, Gauge, Histogram, generate_latest

_FAST = (0.005, 0.01, 0.025, 0.05, 0.1, 0.25, 0.5, 1.0, 2.5, 5.0, 10.0, 30.0)
_SLOW = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0, 120.0, 300.0, 600.0)


class Metrics:
    """Counters of one service; labels come from fixed sets only."""

    def __init__(self) -> None:
        self.registry = CollectorRegistry()
        self.requests = Counter(
            "physretarget_requests", "Requests answered.", ("method", "route", "status"),
            registry=self.registry,
        )  # fmt: skip
        self.latency = Histogram(
            "physretarget_request_seconds", "Time until an answer began.", ("method", "route"),
            buckets=_FAST, registry=self.registry,
        )  # fmt: skip
        self.submitted = Counter(
            "physretarget_jobs_submitted", "Jobs accepted.", ("kind",), registry=self.registry
        )
        self.finished = Counter(
            "physretarget_jobs_finished", "Jobs ended.", ("kind", "status"),
            registry=self.registry,
        )  # fmt: skip
        self.failures = Counter(
            "physretarget_child_failures", "Child processes that failed.", ("why",),
            registry=self.registry,
        )  # fmt: skip
        self.seconds = Histogram(
            "physretarget_job_seconds", "Time a job took in its worker.", ("kind",),
            buckets=_SLOW, registry=self.registry,
        )  # fmt: skip
        self.upload_bytes = Counter(
            "physretarget_upload_bytes", "Bytes of files received.", registry=self.registry
        )
        self.jobs = Gauge(
            "physretarget_jobs", "Jobs by status.", ("status",), registry=self.registry
        )
        self.workers = Gauge("physretarget_workers", "Worker threads.", registry=self.registry)

    def text(self) -> bytes:
        """All of it in Prometheus' text format."""
        return generate_latest(self.registry)
