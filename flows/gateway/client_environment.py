"""What a client of the gateway needs in its environment, as lines for a shell."""

import shlex
import socket
from collections.abc import Iterator
from pathlib import Path

from specs.settings import region
from tasks.gateway.access.access_key import AccessKey

_EVERYWHERE = frozenset({"0.0.0.0", "::", ""})  # noqa: S104 - to be told apart from names that clients can ask for


def gateway_url(host: str, port: int, *, is_encrypted: bool) -> str:
    """Returns the address that clients ask for."""
    named = socket.gethostname() if host in _EVERYWHERE else f"[{host}]" if ":" in host else host
    return f"{'https' if is_encrypted else 'http'}://{named}:{port}"


def export_lines(key: AccessKey, url: str, model: Path | None = None) -> Iterator[str]:
    """Yields lines that a shell obeys, after which boto3 and the AWS CLI find the gateway; they hold the secret.

    Args:
        key: Whose they are.
        url: Of the gateway.
        model: The folder with RoboMaker's model, if SDKs do not find it themselves.

    Raises:
        DocumentError: SIMYARD_REGION is no name of a region.
    """
    variables = {
        "AWS_ACCESS_KEY_ID": key.key_id,
        "AWS_SECRET_ACCESS_KEY": key.secret,
        "AWS_ENDPOINT_URL_ROBOMAKER": url,
        "AWS_DEFAULT_REGION": region(),
        **({"AWS_DATA_PATH": str(model.expanduser().absolute())} if model else {}),
    }
    for name, value in variables.items():
        yield f"export {name}={shlex.quote(value)}"
    yield "unset AWS_SESSION_TOKEN"
    if model is None:
        yield "# SDKs that have no model of RoboMaker: simyard serve --model-only --model ~/.aws/models"
