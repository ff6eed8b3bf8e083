"""A real S3 server for tests: SeaweedFS, from its wheel, on free ports of this machine."""

import json
import subprocess
import sysconfig
import time
from collections.abc import Generator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

import botocore.session
from botocore.config import Config
from botocore.exceptions import BotoCoreError, ClientError

from tests.servers.ports import free_ports

ACCESS_KEY = "simyard-test-key"
SECRET_KEY = "simyard-test-secret"  # noqa: S105 - of a server that lives for one test run
READER_KEY = "simyard-reader-key"
READER_SECRET = "simyard-reader-secret"  # noqa: S105 - same
_PORTS: tuple[str, ...] = ("master", "master.grpc", "volume", "volume.grpc", "filer", "filer.grpc", "s3", "s3.grpc")


class Seaweed:
    """A server, with its data in a folder; started, killed and started again there.

    Attributes:
        endpoint: ``http://127.0.0.1:<port>``.
        process: The server; a test may stop and continue it.
    """

    def __init__(self, folder: Path) -> None:
        """Starts it; see ``wait``."""
        ports: dict[str, int] = dict(zip(_PORTS, free_ports(len(_PORTS)), strict=True))
        self._folder = folder
        self._command = _command(folder, ports)
        self.endpoint = f"http://127.0.0.1:{ports['s3']}"
        self.process = self._started()

    def wait(self) -> None:
        """Returns when it takes writes."""
        _wait(self, self._folder / "weed.log")

    def kill(self) -> None:
        """Ends it as a loss of power does."""
        self.process.kill()
        self.process.wait()

    def start_again(self) -> None:
        """Starts it with the data that it had, and waits until it takes writes."""
        self.process = self._started()
        self.wait()

    def _started(self) -> subprocess.Popen[bytes]:
        with (self._folder / "weed.log").open("ab") as log:
            return subprocess.Popen(self._command, stdout=log, stderr=log, cwd=self._folder)

    def environment(self, *, endpoint: str = "") -> dict[str, str]:
        """Returns what a process needs to reach the server, or it through another endpoint."""
        return {
            "AWS_ACCESS_KEY_ID": ACCESS_KEY,
            "AWS_SECRET_ACCESS_KEY": SECRET_KEY,
            "AWS_ENDPOINT_URL_S3": endpoint or self.endpoint,
            "AWS_REGION": "us-east-1",
            "AWS_DEFAULT_REGION": "us-east-1",
            "AWS_EC2_METADATA_DISABLED": "true",
        }

    def make_bucket(self, bucket: str) -> None:
        """Makes an empty bucket, and writes and removes an object in it."""
        session = botocore.session.Session()
        client = session.create_client(
            "s3",
            region_name="us-east-1",
            endpoint_url=self.endpoint,
            aws_access_key_id=ACCESS_KEY,
            aws_secret_access_key=SECRET_KEY,
            config=Config(retries={"total_max_attempts": 1}),
        )
        try:
            client.create_bucket(Bucket=bucket)
            client.put_object(Bucket=bucket, Key="ready", Body=b"ready")
            client.delete_object(Bucket=bucket, Key="ready")
        finally:
            client.close()


@contextmanager
def running_seaweed(folder: Path) -> Generator[Seaweed]:
    """Starts a server that keeps its data in the folder, waits until it takes writes, and kills it at the end."""
    server = Seaweed(folder)
    try:
        server.wait()
        yield server
    finally:
        server.kill()


def _command(folder: Path, ports: dict[str, int]) -> list[str]:
    identities = [
        _identity("writer", ACCESS_KEY, SECRET_KEY, ["Admin", "Read", "Write", "List", "Tagging"]),
        _identity("reader", READER_KEY, READER_SECRET, ["Read", "List"]),
    ]
    (folder / "s3.json").write_text(json.dumps({"identities": identities}))
    data = folder / "data"
    data.mkdir()
    options = {
        "ip": "127.0.0.1",
        "ip.bind": "127.0.0.1",
        "dir": data,
        **{
            name.replace(".grpc", ".port.grpc") if name.endswith(".grpc") else f"{name}.port": port
            for name, port in ports.items()
        },
        "volume.max": 100,
        "master.volumeSizeLimitMB": 64,
        "master.electionTimeout": "1s",
        "volume.preStopSeconds": 0,
        "filer": "true",
        "filer.localSocket": folder / "filer.sock",
        "s3": "true",
        "s3.port.iceberg": 0,
        "s3.port.lance": 0,
        "s3.config": folder / "s3.json",
        "s3.iam": "false",
        "s3.localSocket": folder / "s3.sock",
        "master.telemetry": "false",
    }
    weed = Path(sysconfig.get_path("scripts")) / "weed"
    return [str(weed), "-logtostderr=true", "server", *(f"-{name}={value}" for name, value in options.items())]


def _identity(name: str, key: str, secret: str, actions: list[str]) -> dict[str, object]:
    return {"name": name, "credentials": [{"accessKey": key, "secretKey": secret}], "actions": actions}


def _wait(server: Seaweed, log: Path) -> None:
    for attempt in count():
        try:
            server.make_bucket(f"ready-{attempt}")
        except (BotoCoreError, ClientError) as exc:
            if server.process.poll() is not None:
                raise RuntimeError(f"SeaweedFS did not start:\n{log.read_text()[-4000:]}") from exc
            time.sleep(0.2)
        else:
            return
