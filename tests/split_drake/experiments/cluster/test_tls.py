"""A scheduler that asks for keys: Dask's own settings are passed through."""

import shutil
import subprocess
from pathlib import Path

import dask
import pytest

from split_drake.experiments.cluster.dask_pool import DaskPool
from tests.helpers import farmed
from tests.helpers.cluster import Cluster

pytestmark = pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the keys")


def test_a_run_goes_through_tls(tmp_path: Path) -> None:
    key, certificate = tmp_path / "key.pem", tmp_path / "certificate.pem"
    command = [
        "openssl",
        "req",
        "-x509",
        "-newkey",
        "rsa:2048",
        "-nodes",
        "-days",
        "2",
        "-subj",
        "/CN=split",
    ]
    subprocess.run(
        [*command, "-keyout", str(key), "-out", str(certificate)], check=True, capture_output=True
    )
    arguments = [f"--tls-ca-file={certificate}", f"--tls-cert={certificate}", f"--tls-key={key}"]
    cluster = Cluster(tmp_path, arguments=arguments, scheme="tls")
    both = {"cert": str(certificate), "key": str(key)}
    try:
        cluster.start_scheduler()
        cluster.start_worker()
        with dask.config.set(
            {
                "distributed.comm.tls.ca-file": str(certificate),
                "distributed.comm.tls.client": both,
            }
        ):
            assert sorted(DaskPool(cluster.address, farmed.square).run([1, 2])) == [1, 4]
    finally:
        cluster.end()
