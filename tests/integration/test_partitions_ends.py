"""If this fails, tasks of a render go on though nobody wants them, an engine that goes away ends in a hang, or TLS does not work."""

from __future__ import annotations

import datetime
import importlib.util
import ipaddress
import signal
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from integration.dask_cluster import NEEDS, dask_cluster
from integration.scenectl_process import await_progress, command, environment, scenectl

END_S = 60.0
ROOM = "v 0 0 0\nv 4 0 0\nv 4 0 4\nv 0 0 4\nv 0 3 0\nv 4 3 0\nf 1 2 3 4\nf 1 2 6 5\n"
SKY = ("--sky", "0.5,0.6,0.7", "--size", "48x32", "--depth", "1")
HAS_DASK = all(importlib.util.find_spec(name) for name in ("dask", "distributed"))

pytestmark = [pytest.mark.timeout(360), pytest.mark.skipif(not HAS_DASK, reason=NEEDS)]


@contextmanager
def rendering(folder: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A render of the room in the folder, of which a part is done, and which would take hours."""
    (folder / "room.obj").write_text(ROOM)
    words = command("render", "still", folder / "room.obj", *SKY, "--samples", "1000000", "-o", folder / "o.exr", *arguments)
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=environment(None), text=True) as process:
        try:
            await_progress(process)
            yield process
        finally:
            process.kill()


def last_words(process: subprocess.Popen[str]) -> list[str]:
    _, said = process.communicate(timeout=END_S)
    assert "Traceback" not in said
    return [line for line in said.splitlines() if line and not line.startswith(("render:", "prepare:"))]


def test_ctrl_c_ends_threads(tmp_path: Path) -> None:
    with rendering(tmp_path, "--partition", "visual", "--threads", "2") as process:
        process.send_signal(signal.SIGINT)
        assert last_words(process) == ["error: interrupted: the same command may be given again"]
        assert process.returncode == 130
    assert sorted(path.name for path in tmp_path.iterdir()) == ["room.obj"]


@pytest.mark.long
def test_ctrl_c_ends_the_tasks_of_an_engine(tmp_path: Path) -> None:
    engine = tmp_path / "engine"
    engine.mkdir()
    with dask_cluster(1, engine) as address:
        with rendering(tmp_path, "--partition", "visual", "--engine", address) as process:
            process.send_signal(signal.SIGINT)
            assert last_words(process) == ["error: interrupted: the same command may be given again"]
            assert process.returncode == 130
        # Its only worker has nothing else to do.
        more = ("--samples", "2", "--partition", "visual", "--engine", address, "-o", tmp_path / "next.exr")
        ended = scenectl("render", "still", tmp_path / "room.obj", *SKY, *more)
        assert ended.code == 0, ended.err


@pytest.mark.long
def test_an_engine_that_goes_away_is_one_clear_error(tmp_path: Path) -> None:
    engine = tmp_path / "engine"
    engine.mkdir()
    with ExitStack() as stack:
        address = stack.enter_context(dask_cluster(1, engine))
        with rendering(tmp_path, "--partition", "visual", "--engine", address) as process:
            stack.close()
            said = last_words(process)
            assert process.returncode == 3
            (line,) = said
            assert line.startswith("error: the engine's scheduler has gone")


@pytest.mark.long
def test_an_engine_by_tls(tmp_path: Path) -> None:
    settings = certificates(tmp_path)
    (tmp_path / "room.obj").write_text(ROOM)
    wanted = ("render", "still", tmp_path / "room.obj", *SKY, "--samples", "2", "--json", "--partition", "visual")
    with dask_cluster(1, tmp_path, "tls", **settings) as address:
        ended = scenectl(*wanted, "--engine", address, "-o", tmp_path / "a.exr", **settings)
        assert ended.code == 0, ended.err
        assert ended.json["engine"] == address
        stranger = scenectl(*wanted, "--engine", address, "-o", tmp_path / "b.exr")
        assert "which certificates count" in stranger.refusal(1)
    here = scenectl(*wanted, "-o", tmp_path / "c.exr")
    assert here.json["image_sha256"] == ended.json["image_sha256"]


def certificates(folder: Path) -> dict[str, str]:
    """Dask's settings, with a certificate that counts for everybody."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "a test")])
    now = datetime.datetime.now(datetime.UTC)
    here = x509.SubjectAlternativeName([x509.IPAddress(ipaddress.ip_address("127.0.0.1")), x509.DNSName("localhost")])
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(days=1))
        .not_valid_after(now + datetime.timedelta(days=1))
        .add_extension(x509.BasicConstraints(ca=True, path_length=None), critical=True)
        .add_extension(here, critical=False)
        .sign(key, hashes.SHA256())
    )
    own, secret = folder / "certificate.pem", folder / "key.pem"
    own.write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    secret.write_bytes(key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()))
    prefix = "DASK_DISTRIBUTED__COMM__TLS__"
    of_all = {
        f"{prefix}{who}__{what}": str(path) for who in ("SCHEDULER", "WORKER", "CLIENT") for what, path in (("CERT", own), ("KEY", secret))
    }
    return {f"{prefix}CA_FILE": str(own), **of_all}
