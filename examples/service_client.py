"""Have a running service judge a clip.

    python examples/service_client.py http://127.0.0.1:8000 walk.npz lamp

With a token in $PHYSRETARGET_TOKEN where the service asks for one.
"""

import os
import sys
import time
import uuid
from pathlib import Path

import httpx

address, clip, model = sys.argv[1:]
token = os.environ.get("PHYSRETARGET_TOKEN")
headers = {"Authorization": f"Bearer {token}"} if token else {}
with httpx.Client(base_url=address, headers=headers, timeout=60) as service:
    # The key makes a submission that is sent twice, after a lost answer, one job.
    answer = service.post(
        "/api/v1/jobs",
        files={"clip": (Path(clip).name, Path(clip).read_bytes())},
        data={"model": model},
        headers={"Idempotency-Key": str(uuid.uuid4())},
    )
    if answer.is_error:
        sys.exit(answer.json()["error"]["message"])
    job = answer.json()
    while job["status"] in {"queued", "running"}:
        time.sleep(0.2)
        job = service.get(f"/api/v1/jobs/{job['id']}").json()
    if job["status"] != "done":
        sys.exit(f"{job['status']}: {job['error']}")
    report = service.get(f"/api/v1/jobs/{job['id']}/report").json()
print(report["summary"]["verdict"], report["measures"]["unexplained_force_rms_bw"]["value"])
